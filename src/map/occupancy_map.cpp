#include "acmp_mapping/map/occupancy_map.h"

#include <octomap/OcTree.h>
#include <octomap/Pointcloud.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr double kMaxVoxelsFromOrigin = 32000;  ///< OctoMap's keys have 16 bits

octomap::point3d ToPoint(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

/// Ends of the keyframe's rays in the world.
octomap::Pointcloud RayEnds(const PlacedKeyframe& keyframe, double max_coordinate) {
  octomap::Pointcloud ends;
  ends.reserve(keyframe.points_in_camera->size());
  for (const SurfacePoint& point : *keyframe.points_in_camera) {
    if (point.confidence < kMinOccupancyConfidence) continue;
    const Vec3f& p = point.position;
    const Eigen::Vector3d end = keyframe.world_from_cam * (keyframe.scale * Eigen::Vector3d(p.x, p.y, p.z));
    if (!(end.cwiseAbs().maxCoeff() < max_coordinate)) {
      throw InvalidInputError(Concat("a point at (", end.x(), ", ", end.y(), ", ", end.z(), "): must be within ",
                                     max_coordinate, " of the origin; the voxel size must be larger"));
    }
    ends.push_back(ToPoint(end));
  }
  return ends;
}

Occupancy OccupancyOf(const octomap::OcTree& tree, const octomap::OcTreeNode* node) {
  if (!node) return Occupancy::kUnknown;
  return tree.isNodeOccupied(node) ? Occupancy::kOccupied : Occupancy::kFree;
}

}  // namespace

struct OccupancyMap::Tree : octomap::OcTree {
  using OcTree::OcTree;

  Occupancy ColumnAt(octomap::OcTreeKey key, octomap::key_type last) const {
    bool all_free = true;
    for (int z = key[2]; z <= last; ++z) {
      key[2] = static_cast<octomap::key_type>(z);
      const Occupancy voxel = OccupancyOf(*this, search(key));
      if (voxel == Occupancy::kOccupied) return voxel;
      all_free = all_free && voxel == Occupancy::kFree;
    }
    return all_free ? Occupancy::kFree : Occupancy::kUnknown;
  }
};

bool CanMapOccupancy() { return true; }

OccupancyMap::OccupancyMap(double resolution) : resolution_(resolution) {
  if (!(resolution > 0 && std::isfinite(resolution))) {
    throw InvalidInputError(Concat("occupancy: resolution = ", resolution, ": must be > 0 and finite"));
  }
  tree_ = std::make_unique<Tree>(resolution);
}

OccupancyMap::~OccupancyMap() = default;

void OccupancyMap::Insert(const PlacedKeyframe& keyframe) {
  const double max_coordinate = kMaxVoxelsFromOrigin * resolution_;
  const Eigen::Vector3d& camera = keyframe.world_from_cam.translation();
  if (!(camera.cwiseAbs().maxCoeff() < max_coordinate)) {
    throw InvalidInputError(Concat("a camera at (", camera.x(), ", ", camera.y(), ", ", camera.z(),
                                   "): must be within ", max_coordinate, " of the origin"));
  }
  const octomap::Pointcloud ends = RayEnds(keyframe, max_coordinate);
  constexpr double kNoLimit = -1;
  const bool inner_nodes_later = true, one_ray_per_voxel = true;
  tree_->insertPointCloud(ends, ToPoint(camera), kNoLimit, inner_nodes_later, one_ray_per_voxel);
}

Occupancy OccupancyMap::At(const Eigen::Vector3d& point_in_world) const {
  const bool in_reach = point_in_world.cwiseAbs().maxCoeff() < kMaxVoxelsFromOrigin * resolution_;
  return in_reach ? OccupancyOf(*tree_, tree_->search(ToPoint(point_in_world))) : Occupancy::kUnknown;
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
  slice.cells.reserve(static_cast<size_t>(slice.width) * static_cast<size_t>(slice.height));
  const octomap::key_type left = key[0];
  for (int y = key[1]; y <= last[1]; ++y) {
    key[1] = static_cast<octomap::key_type>(y);
    for (int x = left; x <= last[0]; ++x) {
      key[0] = static_cast<octomap::key_type>(x);
      slice.cells.push_back(tree_->ColumnAt(key, std::max(last[2], key[2])));
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

}  // namespace acmp
