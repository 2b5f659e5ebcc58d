#include "acmp_mapping/ros/map_store.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/voxel_map.h"

namespace acmp {
namespace {

/// Of a cloud that is not empty.
double MedianDepth(const PointCloud& points) {
  std::vector<float> depths(points.size());
  std::transform(points.begin(), points.end(), depths.begin(), [](const SurfacePoint& p) { return p.position.z; });
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

}  // namespace

void Validate(const MapStoreOptions& options) {
  CheckRange("max_keyframes", options.max_keyframes, 1, 1000000);
  CheckRange("voxel_size", options.voxel_size, 0.0, 1e6);
}

MapStore::MapStore(const MapStoreOptions& options) : options_(options) { Validate(options); }

void MapStore::set_options(const MapStoreOptions& options) {
  Validate(options);
  std::lock_guard<std::mutex> lock(mutex_);
  options_ = options;
}

void MapStore::Add(int64_t id, const RigidTransform& world_from_cam, const PointCloud& points_in_camera) {
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (auto_voxel_size_ == 0 && !points_in_camera.empty()) {
      auto_voxel_size_ = kAutoVoxelRatio * MedianDepth(points_in_camera);
    }
    voxel_size = options_.voxel_size > 0 ? options_.voxel_size : auto_voxel_size_;
  }
  auto thinned = std::make_shared<const PointCloud>(
      points_in_camera.empty() ? PointCloud() : VoxelFilter(points_in_camera, static_cast<float>(voxel_size)));

  std::lock_guard<std::mutex> lock(mutex_);
  points_ += thinned->size();
  // In the order of ids: the map does not depend on which keyframe was finished first.
  const auto place = std::upper_bound(keyframes_.begin(), keyframes_.end(), id,
                                      [](int64_t i, const Keyframe& keyframe) { return i < keyframe.id; });
  keyframes_.insert(place, {id, world_from_cam, std::move(thinned)});
  while (keyframes_.size() > static_cast<size_t>(options_.max_keyframes)) {
    points_ -= keyframes_.front().points_in_camera->size();
    keyframes_.pop_front();
    ++evicted_;
  }
  ++version_;
}

void MapStore::Clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  keyframes_.clear();
  auto_voxel_size_ = 0;
  points_ = 0;
  evicted_ = 0;
  ++version_;
}

PointCloud MapStore::WorldCloud() const {
  std::deque<Keyframe> keyframes;
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    keyframes = keyframes_;
    voxel_size = options_.voxel_size > 0 ? options_.voxel_size : auto_voxel_size_;
  }
  PointCloud map;
  for (const Keyframe& keyframe : keyframes) {
    const PointCloud moved = Transform(keyframe.world_from_cam, *keyframe.points_in_camera);
    map.insert(map.end(), moved.begin(), moved.end());
  }
  return map.empty() ? map : VoxelFilter(map, static_cast<float>(voxel_size));
}

MapStatistics MapStore::statistics() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return {keyframes_.size(), points_, evicted_, options_.voxel_size > 0 ? options_.voxel_size : auto_voxel_size_};
}

uint64_t MapStore::version() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return version_;
}

}  // namespace acmp
