// What a keyframe of a map tells of the points of others.

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

constexpr float kConfirmingDepth = 0.02f;  ///< relative: as fusion lets views agree
constexpr float kClearlyFarther = 1.05f;

enum class Look : uint8_t { kNothing, kConfirms, kThrough };

/// A point is looked through where all depths around it, 3 x 3 px, are known and clearly farther: beside an outline one
/// of them is not.
Look LookAtPoint(const SurfaceMaps& seen, const Eigen::Vector3d& point) {
  const auto pixel = seen.camera.camera.PixelOf(point);
  if (!pixel) return Look::kNothing;
  const int col = pixel->x(), row = pixel->y();
  const auto z = static_cast<float>(point.z());
  Look look = Look::kThrough;
  for (int r = row - 1; r <= row + 1; ++r) {
    for (int c = col - 1; c <= col + 1; ++c) {
      const float depth = seen.depth.View().Contains(c, r) ? seen.depth(c, r) : 0;
      if (std::abs(depth - z) < kConfirmingDepth * z) return Look::kConfirms;
      if (!(depth > kClearlyFarther * z)) look = Look::kNothing;
    }
  }
  return look;
}

float TimesOdds(float confidence, float factor) { return confidence * factor / (1 + confidence * (factor - 1)); }

void CountOne(uint8_t* count) { *count = static_cast<uint8_t>(std::min(*count + 1, 255)); }

bool HasGone(const LaterViews& views) {
  constexpr int kSeveral = 3, kOutweigh = 2;
  return views.through >= kSeveral && views.through > kOutweigh * views.confirming;
}

/// Takes what a later keyframe saw to what is known of an earlier one's points. A point goes that three later keyframes
/// or more see through, and more than twice as many as confirm it: it was never there, or has moved since. The odds of
/// others rise by a fifth with each keyframe that confirms them, and fall by half with each that sees through them.
/// Nothing changes where the keyframe sees through more points than it confirms: then the poses do not fit together.
/// @param seen what that one's points show (SplatPoints); empty without points
/// @param later_from_points from the points' frame to the later camera's
/// @param views one per point
/// @return whether anything was changed
bool TakeLaterView(const SurfaceMaps& seen, const Similarity& later_from_points, PointCloud* points,
                   std::vector<LaterViews>* views) {
  constexpr float kConfirmed = 1.2f, kLookedThrough = 0.5f;
  if (seen.depth.empty()) return false;
  std::vector<Look> looks(points->size());
  tbb::parallel_for(size_t{0}, looks.size(), [&](size_t i) {
    const Vec3f& p = (*points)[i].position;
    const Eigen::Vector3d scaled = later_from_points.scale * Eigen::Vector3d(p.x, p.y, p.z);
    looks[i] = LookAtPoint(seen, later_from_points.rigid * scaled);
  });
  const auto confirming = std::count(looks.begin(), looks.end(), Look::kConfirms);
  if (confirming == 0 || std::count(looks.begin(), looks.end(), Look::kThrough) > confirming) return false;
  size_t kept = 0;
  for (size_t i = 0; i < looks.size(); ++i) {
    SurfacePoint point = (*points)[i];
    LaterViews of_point = (*views)[i];
    if (looks[i] == Look::kConfirms) {
      CountOne(&of_point.confirming);
      point.confidence = TimesOdds(point.confidence, kConfirmed);
    } else if (looks[i] == Look::kThrough) {
      CountOne(&of_point.through);
      point.confidence = TimesOdds(point.confidence, kLookedThrough);
      if (HasGone(of_point)) continue;
    }
    (*points)[kept] = point;
    (*views)[kept++] = of_point;
  }
  points->resize(kept);
  views->resize(kept);
  return true;
}

/// From an earlier keyframe's points to a later camera and the size of its points. In the world of refined poses, which
/// fit best, where both have one.
Similarity LaterFromEarlier(const KeyframePose& later, const CorrectedPose& later_corrected,
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
  Similarity later_from_earlier = {later_from_world * world_from_earlier, later_size / earlier_size};
  later_from_earlier.rigid.translation() *= later_size;
  return later_from_earlier;
}

}  // namespace

std::vector<KeyframeKey> MapStore::Around(const KeyframeKey& key) const {
  constexpr double kSameDirection = 0.3;  // cosine: within 70 degrees they can see the same
  std::vector<std::pair<double, KeyframeKey>> around;
  const auto found = keyframes_.find(key);
  if (found == keyframes_.end() || found->second.points_in_camera->empty()) return {};
  const CorrectedPose& added = found->second.pose;
  const RigidTransform& here = added.world_from_cam;
  for (const auto& [other_key, other] : keyframes_) {
    const RigidTransform& there = other.pose.world_from_cam;
    const double distance = (here.translation() - there.translation()).norm();
    if (other_key == key || other.points_in_camera->empty() || distance > added.scale * added.reach ||
        here.linear().col(2).dot(there.linear().col(2)) < kSameDirection) {
      continue;
    }
    around.emplace_back(distance, other_key);
  }
  std::sort(around.begin(), around.end());
  // Near ones and far ones, as points are to be looked at from several sides.
  std::vector<KeyframeKey> chosen;
  const size_t count = std::min(around.size(), kMaxLookedAt);
  for (size_t i = 0; i < count; ++i) chosen.push_back(around[i * around.size() / count].second);
  return chosen;
}

bool MapStore::LookAroundNext() {
  struct Looked {
    KeyframeKey key;
    Keyframe keyframe;
    PackedCloudPtr points_before;
  };
  std::vector<Looked> all(1);  // the keyframe that looks, as it was added, and those around it
  double voxel_size = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (to_look_.empty()) return false;
    const ToLook due = std::move(to_look_.front());
    to_look_.pop_front();
    voxel_size = VoxelSize();
    const Keyframe& found = keyframes_.at(due.key);
    all[0].key = due.key;
    all[0].keyframe.pose = found.pose;
    all[0].keyframe.as_sent = due.as_sent;
    all[0].keyframe.points_in_camera = all[0].points_before = due.points_in_camera;
    for (const KeyframeKey& other : due.around) {
      const auto neighbour = keyframes_.find(other);
      // One that was replaced since then would have forgotten this look.
      if (neighbour == keyframes_.end() || neighbour->second.points_arrival > found.arrival) continue;
      all.push_back({other, neighbour->second, neighbour->second.points_in_camera});
    }
  }
  const auto seen_by = [&](const Keyframe& keyframe) {
    const PointCloud points = keyframe.points_in_camera->Unpack();
    return SplatPoints(points, RigidTransform::Identity(), PointSpacing(points, voxel_size));
  };
  const auto take = [](const SurfaceMaps& seen, const Keyframe& later, Keyframe* earlier) {
    const Similarity pose = LaterFromEarlier(later.as_sent, later.pose, earlier->as_sent, earlier->pose);
    PointCloud points = earlier->points_in_camera->Unpack();
    auto views = earlier->later_views ? std::make_shared<std::vector<LaterViews>>(*earlier->later_views)
                                      : std::make_shared<std::vector<LaterViews>>(points.size());
    if (!TakeLaterView(seen, pose, &points, views.get())) return;
    earlier->points_in_camera = std::make_shared<const PackedCloud>(points);
    earlier->later_views = std::move(views);
  };
  Keyframe& added = all[0].keyframe;
  const SurfaceMaps seen = seen_by(added);
  for (size_t i = 1; i < all.size(); ++i) {
    Keyframe& other = all[i].keyframe;
    if (other.pose.stamp_ns < added.pose.stamp_ns) take(seen, added, &other);
    if (other.pose.stamp_ns > added.pose.stamp_ns) take(seen_by(other), other, &added);
  }
  std::lock_guard<std::mutex> lock(mutex_);
  for (Looked& looked : all) {
    const PackedCloudPtr& before = looked.points_before;
    const auto keyframe = keyframes_.find(looked.key);
    const bool is_changed = looked.keyframe.points_in_camera != before;
    // It may have gone meanwhile, or have other points.
    if (!is_changed || keyframe == keyframes_.end() || keyframe->second.points_in_camera != before) continue;
    statistics_.looked_through += before->size() - looked.keyframe.points_in_camera->size();
    statistics_.points -= before->size() - looked.keyframe.points_in_camera->size();
    keyframe->second.points_in_camera = std::move(looked.keyframe.points_in_camera);
    keyframe->second.later_views = std::move(looked.keyframe.later_views);
    ++version_;
  }
  return true;
}

}  // namespace acmp
