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
  CheckRange("map_radius", options.map_radius, 0.0, 1e9);
  CheckRange("voxel_size", options.voxel_size, 0.0, 1e6);
}

MapStore::MapStore(const MapStoreOptions& options) : options_(options) { Validate(options); }

void MapStore::set_options(const MapStoreOptions& options) {
  Validate(options);
  std::lock_guard<std::mutex> lock(mutex_);
  options_ = options;
}

void MapStore::AddPose(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam) {
  std::lock_guard<std::mutex> lock(mutex_);
  FindOrAdd(id, stamp_ns, world_from_cam);
  Evict();
}

std::shared_ptr<const PointCloud> MapStore::Thinned(const PointCloud& points) {
  if (points.empty()) return std::make_shared<const PointCloud>();
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (auto_voxel_size_ == 0) auto_voxel_size_ = kAutoVoxelRatio * MedianDepth(points);
    voxel_size = VoxelSize();
  }
  return std::make_shared<const PointCloud>(VoxelFilter(points, static_cast<float>(voxel_size)));
}

void MapStore::AddPoints(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam,
                         const PointCloud& points_in_camera) {
  std::shared_ptr<const PointCloud> thinned = Thinned(points_in_camera);
  std::lock_guard<std::mutex> lock(mutex_);
  statistics_.points += thinned->size();
  ++statistics_.keyframes;
  FindOrAdd(id, stamp_ns, world_from_cam)->points_in_camera = std::move(thinned);
  Evict();
  ++version_;
}

bool MapStore::ReplacePoints(int64_t id, const PointCloud& points_in_camera) {
  if (!HasPoints(id)) return false;
  std::shared_ptr<const PointCloud> thinned = Thinned(points_in_camera);
  std::lock_guard<std::mutex> lock(mutex_);
  const size_t place = PlaceOf(id);
  if (!HasPointsAt(place, id)) return false;
  std::shared_ptr<const PointCloud>& points = keyframes_[place].points_in_camera;
  statistics_.points += thinned->size();
  statistics_.points -= points->size();
  points = std::move(thinned);
  ++version_;
  return true;
}

bool MapStore::HasPoints(int64_t id) const {
  std::lock_guard<std::mutex> lock(mutex_);
  return HasPointsAt(PlaceOf(id), id);
}

size_t MapStore::PlaceOf(int64_t id) const {
  const auto place = std::lower_bound(keyframes_.begin(), keyframes_.end(), id,
                                      [](const Keyframe& keyframe, int64_t i) { return keyframe.id < i; });
  return static_cast<size_t>(place - keyframes_.begin());
}

bool MapStore::HasPointsAt(size_t place, int64_t id) const {
  return place < keyframes_.size() && keyframes_[place].id == id && keyframes_[place].points_in_camera != nullptr;
}

MapStore::Keyframe* MapStore::FindOrAdd(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam) {
  const size_t place = PlaceOf(id);
  if (place < keyframes_.size() && keyframes_[place].id == id) return &keyframes_[place];
  Keyframe keyframe;
  keyframe.id = id;
  keyframe.run = run_;
  keyframe.pose.stamp_ns = stamp_ns;
  keyframe.pose.received = keyframe.pose.world_from_cam = world_from_cam;
  const auto position = keyframes_.begin() + static_cast<std::ptrdiff_t>(place);
  Keyframe* const added = &*keyframes_.insert(position, std::move(keyframe));
  ApplyPath();
  return added;
}

ReposeResult MapStore::Repose(std::vector<StampedPose> path, int64_t tolerance_ns) {
  if (path.empty()) return {};
  SortPath(&path);
  std::lock_guard<std::mutex> lock(mutex_);
  path_ = std::move(path);
  path_tolerance_ns_ = tolerance_ns;
  ++statistics_.paths;
  ReposeResult result = ApplyPath();
  if (!result.moved.empty()) {
    ++statistics_.corrections;
    statistics_.reposed += result.moved.size();
    Evict();
  }
  return result;
}

ReposeResult MapStore::ApplyPath() {
  if (path_.empty()) return {};
  const auto begin = std::find_if(keyframes_.begin(), keyframes_.end(),
                                  [this](const Keyframe& keyframe) { return keyframe.run == run_; });
  std::vector<CorrectedPose*> run;
  for (auto keyframe = begin; keyframe != keyframes_.end(); ++keyframe) run.push_back(&keyframe->pose);
  ReposeResult result = acmp::Repose(path_, path_tolerance_ns_, {kSamePoseVoxels * VoxelSize(), kSamePoseRad}, run);
  statistics_.path_poses = path_.size();
  statistics_.path_unmatched = result.unmatched;
  const bool map_moved = std::any_of(result.moved.begin(), result.moved.end(), [&](size_t i) {
    return begin[static_cast<std::ptrdiff_t>(i)].points_in_camera != nullptr;
  });
  if (map_moved) ++version_;
  return result;
}

void MapStore::Evict() {
  if (options_.map_radius > 0) {
    const Eigen::Vector3d newest = keyframes_.back().pose.world_from_cam.translation();
    const auto far = [&](const Keyframe& keyframe) {
      if (!((keyframe.pose.world_from_cam.translation() - newest).norm() > options_.map_radius)) return false;
      Forget(keyframe, &statistics_.evicted_by_radius);
      return true;
    };
    keyframes_.erase(std::remove_if(keyframes_.begin(), keyframes_.end(), far), keyframes_.end());
  }
  // Keyframes without points have a limit of their own: they must not push out those that have some.
  const auto limit = static_cast<size_t>(options_.max_keyframes);
  const auto evict_oldest = [this](bool with_points) {
    const auto oldest = std::find_if(keyframes_.begin(), keyframes_.end(), [&](const Keyframe& keyframe) {
      return (keyframe.points_in_camera != nullptr) == with_points;
    });
    Forget(*oldest, &statistics_.evicted);
    keyframes_.erase(oldest);
  };
  while (statistics_.keyframes > limit) evict_oldest(true);
  while (keyframes_.size() - statistics_.keyframes > limit) evict_oldest(false);
}

void MapStore::Forget(const Keyframe& keyframe, size_t* counter) {
  if (!keyframe.points_in_camera) return;
  statistics_.points -= keyframe.points_in_camera->size();
  --statistics_.keyframes;
  ++*counter;
  ++version_;
}

void MapStore::Clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  keyframes_.clear();
  path_.clear();
  auto_voxel_size_ = 0;
  statistics_ = {};
  ++version_;
}

void MapStore::StartRun() {
  std::lock_guard<std::mutex> lock(mutex_);
  ++run_;
  path_.clear();
}

PointCloud MapStore::WorldCloud() const {
  std::vector<std::shared_ptr<const PointCloud>> clouds;  // keeps them alive
  std::vector<PlacedCloud> placed;
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (const Keyframe& keyframe : keyframes_) {
      if (!keyframe.points_in_camera || keyframe.points_in_camera->empty()) continue;
      clouds.push_back(keyframe.points_in_camera);
      placed.push_back({keyframe.pose.world_from_cam, keyframe.points_in_camera.get()});
    }
    voxel_size = VoxelSize();
  }
  return placed.empty() ? PointCloud() : MergeClouds(placed, static_cast<float>(voxel_size));
}

std::vector<StampedPose> MapStore::Path() const {
  std::lock_guard<std::mutex> lock(mutex_);
  std::vector<StampedPose> path;
  path.reserve(keyframes_.size());
  for (const Keyframe& keyframe : keyframes_) path.push_back({keyframe.pose.stamp_ns, keyframe.pose.world_from_cam});
  return path;
}

MapStatistics MapStore::statistics() const {
  std::lock_guard<std::mutex> lock(mutex_);
  MapStatistics statistics = statistics_;
  statistics.voxel_size = VoxelSize();
  return statistics;
}

uint64_t MapStore::version() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return version_;
}

}  // namespace acmp
