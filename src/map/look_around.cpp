// What a keyframe of a map tells of the points of others.

#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/map/later_views.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

/// Takes positions, multiplied by `scale` first, to another frame.
struct ScaledPose {
  RigidTransform target_from_source;
  double scale = 1;
};

/// From an earlier keyframe's points to a later camera and the size of its points. In the world of refined poses, which
/// fit best, where both have one.
ScaledPose LaterFromEarlier(const KeyframePose& later, const CorrectedPose& later_corrected,
                            const KeyframePose& earlier, const CorrectedPose& earlier_corrected) {
  RigidTransform later_from_world, world_from_earlier;
  double later_size, earlier_size;  // of what is 1 in that world
  if (later.refined && earlier.refined && later.refined->refined.world == earlier.refined->refined.world) {
    later_from_world = later.refined->refined.world_from_cam.inverse();
    world_from_earlier = earlier.refined->refined.world_from_cam;
    later_size = later.refined->refined.scale;
    earlier_size = earlier.refined->refined.scale;
  } else {
    later_from_world = later_corrected.Placed(later.world_from_cam).inverse();
    world_from_earlier = earlier_corrected.Placed(earlier.world_from_cam);
    later_size = 1 / later_corrected.scale;
    earlier_size = 1 / earlier_corrected.scale;
  }
  ScaledPose pose = {later_from_world * world_from_earlier, later_size / earlier_size};
  pose.target_from_source.translation() *= later_size;
  return pose;
}

}  // namespace

void MapStore::LookAround(const KeyframeKey& key) {
  struct Neighbour {
    KeyframeKey key;
    Keyframe keyframe;
    double distance;
  };
  constexpr double kSameDirection = 0.3;  // cosine: within 70 degrees they can see the same
  Keyframe added;
  std::vector<Neighbour> around;
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto found = keyframes_.find(key);
    if (found == keyframes_.end() || found->second.points_in_camera->empty()) return;
    added = found->second;
    voxel_size = VoxelSize();
    const RigidTransform& here = added.pose.world_from_cam;
    for (const auto& [other_key, other] : keyframes_) {
      const RigidTransform& there = other.pose.world_from_cam;
      const double distance = (here.translation() - there.translation()).norm();
      if (other_key == key || other.points_in_camera->empty() || distance > added.pose.scale * added.pose.reach ||
          here.linear().col(2).dot(there.linear().col(2)) < kSameDirection) {
        continue;
      }
      around.push_back({other_key, other, distance});
    }
  }
  if (around.empty()) return;
  // Near ones and far ones, as points are to be looked at from several sides.
  std::sort(around.begin(), around.end(), [](const auto& a, const auto& b) { return a.distance < b.distance; });
  if (around.size() > kMaxLookedAt) {
    for (size_t i = 0; i < kMaxLookedAt; ++i) std::swap(around[i], around[i * around.size() / kMaxLookedAt]);
    around.resize(kMaxLookedAt);
  }
  const auto seen_by = [&](const Keyframe& keyframe) {
    return SeenDepthOf(*keyframe.points_in_camera, PointSpacing(*keyframe.points_in_camera, voxel_size));
  };
  const auto take = [](const SeenDepth& seen, const Keyframe& later, Keyframe* earlier) {
    const ScaledPose pose = LaterFromEarlier(later.as_sent, later.pose, earlier->as_sent, earlier->pose);
    auto points = std::make_shared<PointCloud>(*earlier->points_in_camera);
    if (TakeLaterView(seen, pose.target_from_source, pose.scale, points.get(), &earlier->later_views)) {
      earlier->points_in_camera = std::move(points);
    }
  };
  const SeenDepth seen = seen_by(added);
  const std::shared_ptr<const PointCloud> points_before = added.points_in_camera;
  std::vector<std::shared_ptr<const PointCloud>> before;
  for (Neighbour& neighbour : around) {
    before.push_back(neighbour.keyframe.points_in_camera);
    if (neighbour.keyframe.pose.stamp_ns < added.pose.stamp_ns) {
      take(seen, added, &neighbour.keyframe);
    } else if (neighbour.keyframe.pose.stamp_ns > added.pose.stamp_ns) {
      take(seen_by(neighbour.keyframe), neighbour.keyframe, &added);
    }
  }
  std::lock_guard<std::mutex> lock(mutex_);
  const auto put_back = [&](const KeyframeKey& of, const std::shared_ptr<const PointCloud>& old, Keyframe* changed) {
    const auto keyframe = keyframes_.find(of);
    // It may have gone meanwhile.
    if (changed->points_in_camera == old || keyframe == keyframes_.end() || keyframe->second.points_in_camera != old) {
      return;
    }
    statistics_.looked_through += old->size() - changed->points_in_camera->size();
    statistics_.points -= old->size() - changed->points_in_camera->size();
    keyframe->second.points_in_camera = std::move(changed->points_in_camera);
    keyframe->second.later_views = std::move(changed->later_views);
  };
  put_back(key, points_before, &added);
  for (size_t i = 0; i < around.size(); ++i) put_back(around[i].key, before[i], &around[i].keyframe);
}

}  // namespace acmp
