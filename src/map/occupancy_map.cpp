#include "acmp_mapping/map/occupancy_map.h"

#include <octomap/OcTree.h>
#include <octomap/Pointcloud.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr double kMaxVoxelsFromOrigin = 32000;  ///< OctoMap's keys have 16 bits
// What things take in memory, with what malloc adds.
constexpr size_t kNodeBytes = 64;      ///< of the tree; 32 for a leaf, 112 for others
constexpr size_t kRayVoxelBytes = 48;  ///< of a keyframe, while it is inserted
constexpr size_t kCellBytes = 16;      ///< of a slice, with the message that it becomes

octomap::point3d ToPoint(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

}  // namespace

struct OccupancyMap::Tree : octomap::OcTree {
  using OcTree::OcTree;
};

struct OccupancyMap::Rays {
  octomap::Pointcloud ends;  ///< in the world
  size_t voxels = 0;         ///< that they go through, all together
};

OccupancyMap::OccupancyMap(double resolution, OccupancyLimits limits)
    : resolution_(resolution), limits_(std::move(limits)) {
  if (!(resolution > 0 && std::isfinite(resolution))) {
    throw InvalidInputError(Concat("occupancy: resolution = ", resolution, ": must be > 0 and finite"));
  }
  tree_ = std::make_unique<Tree>(resolution);
}

OccupancyMap::~OccupancyMap() = default;

std::optional<OccupancyMap::Rays> OccupancyMap::FindRays(const PlacedKeyframe& keyframe) const {
  const double max_coordinate = kMaxVoxelsFromOrigin * resolution_;
  const Eigen::Vector3d& camera = keyframe.world_from_cam.translation();
  if (!(camera.cwiseAbs().maxCoeff() < max_coordinate)) return std::nullopt;
  const octomap::OcTreeKey from = tree_->coordToKey(ToPoint(camera));
  Rays rays;
  octomap::KeySet ends;
  const PackedCloud& points = *keyframe.points_in_camera;
  for (size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint point = points[i];
    if (point.confidence < kMinOccupancyConfidence) continue;
    const Vec3f& p = point.position;
    const Eigen::Vector3d end = keyframe.world_from_cam * (keyframe.scale * Eigen::Vector3d(p.x, p.y, p.z));
    if (!(end.cwiseAbs().maxCoeff() < max_coordinate)) return std::nullopt;
    const octomap::OcTreeKey key = tree_->coordToKey(ToPoint(end));
    if (!ends.insert(key).second) continue;
    rays.ends.push_back(tree_->keyToCoord(key));
    for (unsigned i = 0; i < 3; ++i) rays.voxels += static_cast<size_t>(std::abs(int{key[i]} - int{from[i]}));
  }
  return rays;
}

bool OccupancyMap::CanInsert(const std::vector<PlacedKeyframe>& keyframes) const {
  const size_t max_of_one = limits_.max_bytes / 4 / kRayVoxelBytes;
  size_t voxels = 0;
  for (const PlacedKeyframe& keyframe : keyframes) {
    limits_.check();
    const std::optional<Rays> rays = FindRays(keyframe);
    if (!rays || rays->voxels > max_of_one) return false;
    voxels += rays->voxels;
    if (voxels > limits_.max_ray_voxels) return false;
  }
  return true;
}

bool OccupancyMap::Insert(const std::vector<PlacedKeyframe>& keyframes) {
  if (!CanInsert(keyframes)) return false;
  constexpr double kNoLimit = -1;
  const bool inner_nodes_later = true, one_ray_per_voxel = false;  // there is but one already
  for (const PlacedKeyframe& keyframe : keyframes) {
    limits_.check();
    tree_->insertPointCloud(FindRays(keyframe)->ends, ToPoint(keyframe.world_from_cam.translation()), kNoLimit,
                            inner_nodes_later, one_ray_per_voxel);
    if (tree_->size() > limits_.max_bytes / 4 * 3 / kNodeBytes) return false;
  }
  if (tree_->size() == 0) return true;
  double size[3];
  tree_->getMetricSize(size[0], size[1], size[2]);
  return size[0] / resolution_ * (size[1] / resolution_) <= static_cast<double>(limits_.max_bytes / kCellBytes);
}

OccupancySlice OccupancyMap::Slice(double min_height, double max_height) const {
  if (!(min_height < max_height)) {
    throw InvalidInputError(
        Concat("occupancy_min_height = ", min_height, ": must be below occupancy_max_height = ", max_height));
  }
  OccupancySlice slice;
  slice.resolution = resolution_;
  if (tree_->size() == 0) return slice;
  double low[3], high[3];
  tree_->getMetricMin(low[0], low[1], low[2]);
  tree_->getMetricMax(high[0], high[1], high[2]);
  const double bottom = std::max(min_height, -kMaxVoxelsFromOrigin * resolution_);
  const double top = std::min(max_height, kMaxVoxelsFromOrigin * resolution_);
  if (top <= low[2] || bottom >= high[2]) return slice;
  const double half = resolution_ / 2;  // from a border between voxels into one
  octomap::OcTreeKey key = tree_->coordToKey(low[0] + half, low[1] + half, bottom + half);
  const octomap::OcTreeKey last = tree_->coordToKey(high[0] - half, high[1] - half, top - half);
  const octomap::point3d first = tree_->keyToCoord(key);
  slice.origin_x = first.x() - half;
  slice.origin_y = first.y() - half;
  slice.width = last[0] - key[0] + 1;
  slice.height = last[1] - key[1] + 1;
  const octomap::OcTreeKey top_key(last[0], last[1], std::max(last[2], key[2]));
  const int column = top_key[2] - key[2] + 1;
  slice.cells.assign(static_cast<size_t>(slice.width) * static_cast<size_t>(slice.height), Occupancy::kUnknown);
  std::vector<uint16_t> free(slice.cells.size(), 0);  // of each column
  // All leaves are single voxels: nothing has been pruned.
  for (auto leaf = tree_->begin_leafs_bbx(key, top_key), end = tree_->end_leafs_bbx(); leaf != end; ++leaf) {
    const octomap::OcTreeKey at = leaf.getKey();
    const size_t cell = static_cast<size_t>(at[1] - key[1]) * static_cast<size_t>(slice.width) + at[0] - key[0];
    if (tree_->isNodeOccupied(*leaf)) {
      slice.cells[cell] = Occupancy::kOccupied;
    } else if (++free[cell] == column) {
      slice.cells[cell] = Occupancy::kFree;
    }
  }
  return slice;
}

void OccupancyMap::Write(const std::filesystem::path& path) const {
  if (tree_->size() == 0) throw InvalidInputError("the map is empty: nothing was written");
  octomap::OcTree whole(*tree_);  // the format has one bit pair per node: as many nodes as possible become one
  whole.updateInnerOccupancy();
  constexpr int kDigits = 6;
  std::ostringstream bytes = MakeTextFile(kDigits);
  if (!whole.writeBinary(bytes)) throw ProcessingError("cannot make OctoMap's format");
  WriteFileAtomically(path, bytes.str(), Durability::kPowerCut);
}

size_t OccupancyMap::nodes() const { return tree_->size(); }

bool ZPointsUp(const std::vector<PlacedKeyframe>& keyframes) {
  constexpr double kTilt = 0.5;      // 30 degrees to a side on average; 60 degrees of pitch
  constexpr double kBackward = 0.2;  // what looks down may look back a little
  double squared_x = 0;              // of the z components of the cameras' axes
  Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
  double captures = 0;
  const PlacedKeyframe* before = nullptr;
  for (const PlacedKeyframe& keyframe : keyframes) {
    const bool is_other_face =
        before && before->stamp_ns == keyframe.stamp_ns && before->key.mapper == keyframe.key.mapper;
    before = &keyframe;
    if (is_other_face) continue;
    const Eigen::RowVector3d z = keyframe.world_from_cam.linear().row(2);
    squared_x += z.x() * z.x();
    sum += z;
    ++captures;
  }
  const bool looks_down = -sum.z() > kTilt * captures && -sum.y() > -kBackward * captures;
  return squared_x < kTilt * kTilt * captures && (-sum.y() > kTilt * captures || looks_down);
}

std::unique_ptr<OccupancyMap> MakeOccupancyMap(const PlacedKeyframes& map, double resolution,
                                               const OccupancyLimits& limits) {
  if (map.keyframes.empty() || !(map.voxel_size > 0))
    throw InvalidInputError("the map is empty: there is no occupancy");
  for (double size = resolution > 0 ? resolution : kOccupancyVoxels * map.voxel_size;; size *= 2) {
    auto occupancy = std::make_unique<OccupancyMap>(size, limits);
    if (occupancy->Insert(map.keyframes)) return occupancy;
  }
}

}  // namespace acmp
