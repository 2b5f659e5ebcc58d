#include "acmp_mapping/map/occupancy_map.h"

#include <octomap/OcTree.h>
#include <openvdb/Grid.h>
#include <openvdb/math/DDA.h>
#include <openvdb/math/Ray.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

using openvdb::Coord;
/// Of a voxel: keyframes that see an obstacle in it (upper half), and that see through it (lower half).
using CountTree = openvdb::tree::Tree4<int64_t, 5, 4, 3>::Type;
/// Of one keyframe: true where it sees an obstacle, false where it sees through.
using RayTree = openvdb::tree::Tree4<bool, 5, 4, 3>::Type;

constexpr int64_t kHit = int64_t{1} << 32, kMiss = 1;
constexpr double kMaxVoxelsFromOrigin = 32000;  ///< OctoMap's keys have 16 bits
// What things take in memory, with what malloc adds.
constexpr size_t kNodeBytes = 64;   ///< of OctoMap's tree; 32 for a leaf, 112 for others
constexpr size_t kCellBytes = 16;   ///< of a slice, with the message that it becomes
constexpr size_t kCountLeafBytes =  ///< of 8 x 8 x 8 voxels
    sizeof(CountTree::LeafNodeType) + CountTree::LeafNodeType::SIZE * sizeof(int64_t) + 32;
constexpr size_t kRayLeafBytes = sizeof(RayTree::LeafNodeType) + 16;
constexpr int kCountLeafSize = CountTree::LeafNodeType::DIM;

/// By the sensor model; the logarithms of the odds 7 / 3 and 2 / 3.
Occupancy OccupancyOf(int64_t count) {
  if (count == 0) return Occupancy::kUnknown;
  static const double hit = std::log(7.0 / 3), miss = std::log(3.0 / 2);
  const auto hits = static_cast<double>(count >> 32), misses = static_cast<double>(count & (kHit - 1));
  return hits > 0 && hits * hit >= misses * miss ? Occupancy::kOccupied : Occupancy::kFree;
}

Coord ToCoord(const Eigen::Vector3d& voxel) {
  const Eigen::Vector3i index = voxel.array().floor().cast<int>();
  return {index.x(), index.y(), index.z()};
}

VoxelIndex ToIndex(const Coord& at) { return {at.x(), at.y(), at.z()}; }

}  // namespace

void VoxelBox::Add(const VoxelIndex& voxel) {
  for (size_t i = 0; i < 3; ++i) low[i] = std::min(low[i], voxel[i]), high[i] = std::max(high[i], voxel[i]);
}

bool VoxelBox::Contains(const VoxelIndex& voxel) const {
  for (size_t i = 0; i < 3; ++i) {
    if (voxel[i] < low[i] || voxel[i] > high[i]) return false;
  }
  return true;
}

struct OccupancyMap::Voxels {
  CountTree counts{0};
};

struct OccupancyMap::Rays {
  RayTree voxels{false};
};

OccupancyMap::OccupancyMap(double resolution, OccupancyLimits limits)
    : resolution_(resolution), limits_(std::move(limits)) {
  if (!(resolution > 0 && std::isfinite(resolution))) {
    throw InvalidInputError(Concat("occupancy: resolution = ", resolution, ": must be > 0 and finite"));
  }
  voxels_ = std::make_unique<Voxels>();
}

OccupancyMap::~OccupancyMap() = default;

std::unique_ptr<OccupancyMap::Rays> OccupancyMap::FindRays(const PlacedKeyframe& keyframe) const {
  const Eigen::Vector3d camera = keyframe.world_from_cam.translation() / resolution_;
  if (!(camera.cwiseAbs().maxCoeff() < kMaxVoxelsFromOrigin)) return nullptr;
  auto rays = std::make_unique<Rays>();
  openvdb::tree::ValueAccessor<RayTree> at(rays->voxels);
  const Coord from = ToCoord(camera);
  std::vector<Coord> ends;
  const PackedCloud& points = *keyframe.points_in_camera;
  for (size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint point = points[i];
    if (point.confidence < kMinOccupancyConfidence) continue;
    const Vec3f& p = point.position;
    const Eigen::Vector3d end =
        keyframe.world_from_cam * (keyframe.scale * Eigen::Vector3d(p.x, p.y, p.z)) / resolution_;
    if (!(end.cwiseAbs().maxCoeff() < kMaxVoxelsFromOrigin)) return nullptr;
    const Coord voxel = ToCoord(end);
    const bool is_obstacle = limits_.passable.count(point.label) == 0;
    if (at.isValueOn(voxel)) {
      if (is_obstacle) at.setValueOn(voxel, true);
      continue;
    }
    at.setValueOn(voxel, is_obstacle);
    ends.push_back(voxel);
  }
  constexpr size_t kRaysBetweenChecks = 1000;
  constexpr int kJoined = 4;  // voxels in turn that another ray goes through: from there on both do
  const openvdb::Vec3d eye(camera.x(), camera.y(), camera.z());
  for (size_t i = 0; i < ends.size(); ++i) {
    if (i % kRaysBetweenChecks == 0 && rays->voxels.leafCount() * kRayLeafBytes > limits_.max_bytes / 4) return nullptr;
    if (ends[i] == from) continue;
    const openvdb::Vec3d end = ends[i].asVec3d() + openvdb::Vec3d(0.5);
    openvdb::math::DDA<openvdb::math::Ray<double>> walk({end, eye - end, 0, 1});
    for (int joined = 0; joined < kJoined && walk.step();) {
      if (at.isValueOn(walk.voxel())) {
        ++joined;
        continue;
      }
      at.setValueOn(walk.voxel(), false);
      joined = 0;
    }
  }
  return rays;
}

void OccupancyMap::Count(const Rays& rays, int sign) {
  const size_t most_changed = limits_.max_bytes / 20 / sizeof(VoxelIndex);
  for (auto leaf = rays.voxels.cbeginLeaf(); leaf; ++leaf) {
    CountTree::LeafNodeType* counts = voxels_->counts.touchLeaf(leaf->origin());
    for (auto voxel = leaf->cbeginValueOn(); voxel; ++voxel) {
      const int64_t before = counts->getValue(voxel.pos());
      const int64_t after = before + sign * (*voxel ? kHit : kMiss);
      counts->setValueOnly(voxel.pos(), after);
      counts->setActiveState(voxel.pos(), after != 0);
      if (changed_ && OccupancyOf(before) != OccupancyOf(after)) changed_->push_back(ToIndex(voxel.getCoord()));
    }
    if (changed_ && changed_->size() > most_changed) changed_.reset();
  }
}

bool OccupancyMap::Insert(const std::vector<PlacedKeyframe>& keyframes) {
  for (const PlacedKeyframe& keyframe : keyframes) {
    limits_.check();
    const std::unique_ptr<Rays> rays = FindRays(keyframe);
    if (!rays) return false;
    Count(*rays, 1);
    if (bytes() > limits_.max_bytes / 4 * 3 || voxels() > limits_.max_bytes / 4 * 3 / kNodeBytes) return false;
  }
  const VoxelBox box = KnownBox();
  if (box.empty()) return true;
  const auto size = [&](size_t i) { return static_cast<double>(box.high[i]) - box.low[i] + 1; };
  const size_t max_cells = limits_.max_bytes / kCellBytes;
  return size(0) * size(1) <= static_cast<double>(max_cells);
}

void OccupancyMap::Remove(const PlacedKeyframe& keyframe) {
  limits_.check();
  Count(*FindRays(keyframe), -1);
  openvdb::tools::pruneInactive(voxels_->counts);
}

std::optional<std::vector<VoxelIndex>> OccupancyMap::TakeChanged() {
  return std::exchange(changed_, std::vector<VoxelIndex>());
}

Occupancy OccupancyMap::At(const VoxelIndex& voxel) const {
  return OccupancyOf(voxels_->counts.getValue({voxel[0], voxel[1], voxel[2]}));
}

void OccupancyMap::Read(const VoxelBox& box, std::vector<Occupancy>* voxels) const {
  voxels->clear();
  openvdb::tree::ValueAccessor<const CountTree> counts(voxels_->counts);
  for (int x = box.low[0]; x <= box.high[0]; ++x) {
    for (int y = box.low[1]; y <= box.high[1]; ++y) {
      for (int z = box.low[2]; z <= box.high[2]; ++z) voxels->push_back(OccupancyOf(counts.getValue({x, y, z})));
    }
  }
}

VoxelBox OccupancyMap::KnownBox() const {
  openvdb::CoordBBox box;
  if (!voxels_->counts.evalActiveVoxelBoundingBox(box)) return {};
  return {ToIndex(box.min()), ToIndex(box.max())};
}

OccupancySlice OccupancyMap::Slice(double min_height, double max_height) const {
  if (!(min_height < max_height)) {
    throw InvalidInputError(
        Concat("occupancy_min_height = ", min_height, ": must be below occupancy_max_height = ", max_height));
  }
  OccupancySlice slice;
  slice.resolution = resolution_;
  const VoxelBox known = KnownBox();
  if (known.empty()) return slice;
  const auto layer = [&](double height) {
    return static_cast<int>(std::floor(std::clamp(height / resolution_, -kMaxVoxelsFromOrigin, kMaxVoxelsFromOrigin)));
  };
  // A border between voxels belongs to neither side; heights in float64 may miss it by their last bit.
  constexpr double kBit = 1e-9;
  const int bottom = layer(min_height + kBit * resolution_), top = layer(max_height - kBit * resolution_);
  if (top < known.low[2] || bottom > known.high[2]) return slice;
  const int column = top - bottom + 1;
  slice.origin_x = known.low[0] * resolution_;
  slice.origin_y = known.low[1] * resolution_;
  slice.width = known.high[0] - known.low[0] + 1;
  slice.height = known.high[1] - known.low[1] + 1;
  slice.cells.assign(static_cast<size_t>(slice.width) * static_cast<size_t>(slice.height), Occupancy::kUnknown);
  std::vector<uint16_t> free(slice.cells.size(), 0);  // of each column
  for (auto leaf = voxels_->counts.cbeginLeaf(); leaf; ++leaf) {
    if (leaf->origin().z() > top || leaf->origin().z() + kCountLeafSize <= bottom) continue;
    for (auto voxel = leaf->cbeginValueOn(); voxel; ++voxel) {
      const Coord at = voxel.getCoord();
      if (at.z() < bottom || at.z() > top) continue;
      const size_t cell = static_cast<size_t>(at.y() - known.low[1]) * static_cast<size_t>(slice.width) +
                          static_cast<size_t>(at.x() - known.low[0]);
      if (OccupancyOf(*voxel) == Occupancy::kOccupied) {
        slice.cells[cell] = Occupancy::kOccupied;
      } else if (++free[cell] == column) {
        slice.cells[cell] = Occupancy::kFree;
      }
    }
  }
  return slice;
}

size_t OccupancyMap::Write(const std::filesystem::path& path) const {
  if (voxels() == 0) throw InvalidInputError("the map is empty: nothing was written");
  octomap::OcTree tree(resolution_);
  const bool inner_nodes_later = true;
  for (auto voxel = voxels_->counts.cbeginValueOn(); voxel; ++voxel) {
    const Coord at = voxel.getCoord();
    const auto middle = [&](int i) { return (at[i] + 0.5) * resolution_; };
    const bool occupied = OccupancyOf(*voxel) == Occupancy::kOccupied;
    tree.setNodeValue(tree.coordToKey(middle(0), middle(1), middle(2)),
                      occupied ? tree.getClampingThresMaxLog() : tree.getClampingThresMinLog(), inner_nodes_later);
  }
  tree.updateInnerOccupancy();
  const size_t nodes = tree.size();
  constexpr int kDigits = 6;
  std::ostringstream bytes = MakeTextFile(kDigits);
  if (!tree.writeBinary(bytes)) throw ProcessingError("cannot make OctoMap's format");  // which prunes it first
  WriteFileAtomically(path, bytes.str(), Durability::kPowerCut);
  return nodes;
}

size_t OccupancyMap::voxels() const { return voxels_->counts.activeVoxelCount(); }

size_t OccupancyMap::bytes() const { return voxels_->counts.leafCount() * kCountLeafBytes; }

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

LiveOccupancy::Change LiveOccupancy::Update(const PlacedKeyframes& map) {
  Change change;
  if (map.keyframes.empty() || !(map.voxel_size > 0)) {
    change.anew = map_ != nullptr;
    Clear();
    return change;
  }
  try {
    if (map.voxel_size != voxel_size_ || map.origin != origin_) map_.reset();
    double resolution = map_ ? 2 * map_->resolution() : kOccupancyVoxels * map.voxel_size;
    for (; !map_ || !Follow(map); resolution *= 2) {
      change.anew = true;
      keyframes_.clear();
      map_ = std::make_unique<OccupancyMap>(resolution, limits_);
    }
    voxel_size_ = map.voxel_size;
    origin_ = map.origin;
    auto changed = map_->TakeChanged();
    change.anew = change.anew || !changed;
    if (!change.anew) change.changed = std::move(*changed);
    return change;
  } catch (...) {  // what is half done cannot be gone on with
    Clear();
    throw;
  }
}

bool LiveOccupancy::Follow(const PlacedKeyframes& map) {
  EraseGone(map.keyframes, &keyframes_, [this](const PlacedKeyframe& gone) { map_->Remove(gone); });
  for (const PlacedKeyframe& placed : map.keyframes) {
    const auto known = keyframes_.find(placed.key);
    if (known != keyframes_.end()) {
      if (!HasMoved(known->second, placed, kMovedVoxels * map_->resolution())) continue;
      map_->Remove(known->second);
    }
    PlacedKeyframe& keyframe = keyframes_[placed.key] = placed;
    keyframe.image.reset();  // the map may let it go
    if (!map_->Insert({keyframe})) return false;
  }
  return true;
}

void LiveOccupancy::Clear() {
  map_.reset();
  keyframes_.clear();
}

}  // namespace acmp
