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
  const bool is_refined =
      later.refined && earlier.refined && later.refined->refined.world == earlier.refined->refined.world;
  const auto size_of = [&](const KeyframePose& sent, const CorrectedPose& corrected) {  // of what is 1 in that world
    return is_refined ? sent.refined->refined.scale : 1 / corrected.scale;
  };
  const auto world_from_cam = [&](const KeyframePose& sent, const CorrectedPose& corrected) {
    const RigidTransform world_from_capture =
        is_refined ? sent.refined->refined.world_from_cam : corrected.Placed(sent.world_from_capture).rigid;
    return Similarity{world_from_capture, 1 / size_of(sent, corrected)}.Moved(sent.capture_from_cam);
  };
  const double later_size = size_of(later, later_corrected);
  Similarity later_from_earlier = {
      world_from_cam(later, later_corrected).inverse() * world_from_cam(earlier, earlier_corrected),
      later_size / size_of(earlier, earlier_corrected)};
  later_from_earlier.rigid.translation() *= later_size;
  return later_from_earlier;
}

}  // namespace

std::vector<KeyframeKey> MapStore::Around(const KeyframeKey& key) const {
  constexpr double kSameDirection = 0.3;  // cosine: within 70 degrees they can see the same
  std::vector<std::pair<double, KeyframeKey>> around;
  const auto found = keyframes_.find(key);
  if (found == keyframes_.end() || found->second.points_in_camera->empty()) return {};
  const auto world_from_cam = [](const Keyframe& keyframe) {
    const CorrectedPose& pose = keyframe.capture->pose;
    return Similarity{pose.world_from_capture, pose.scale}.Moved(keyframe.as_sent.capture_from_cam);
  };
  const RigidTransform here = world_from_cam(found->second);
  const double reach = found->second.capture->pose.scale * found->second.reach;
  for (const auto& [other_key, other] : keyframes_) {
    const RigidTransform there = world_from_cam(other);
    const double distance = (here.translation() - there.translation()).norm();
    if (other_key == key || other.points_in_camera->empty() || distance > reach ||
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
    CorrectedPose pose;
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
    all[0].pose = found.capture->pose;
    all[0].keyframe.as_sent = due.as_sent;
    all[0].keyframe.points_in_camera = all[0].points_before = due.points_in_camera;
    for (const KeyframeKey& other : due.around) {
      const auto neighbour = keyframes_.find(other);
      // One that was replaced since then would have forgotten this look.
      if (neighbour == keyframes_.end() || neighbour->second.points_arrival > found.arrival) continue;
      const Keyframe& keyframe = neighbour->second;
      all.push_back({other, keyframe, keyframe.capture->pose, keyframe.points_in_camera});
    }
  }
  const auto seen_by = [&](const Keyframe& keyframe) {
    const PointCloud points = keyframe.points_in_camera->Unpack();
    return SplatPoints(points, RigidTransform::Identity(), PointSpacing(points, voxel_size));
  };
  const auto take = [](const SurfaceMaps& seen, const Looked& by_later, Looked* looked) {
    Keyframe* earlier = &looked->keyframe;
    const Similarity pose = LaterFromEarlier(by_later.keyframe.as_sent, by_later.pose, earlier->as_sent, looked->pose);
    PointCloud points = earlier->points_in_camera->Unpack();
    auto views = earlier->later_views ? std::make_shared<std::vector<LaterViews>>(*earlier->later_views)
                                      : std::make_shared<std::vector<LaterViews>>(points.size());
    if (!TakeLaterView(seen, pose, &points, views.get())) return;
    earlier->points_in_camera = std::make_shared<const PackedCloud>(points);
    earlier->later_views = std::move(views);
  };
  Looked& added = all[0];
  const SurfaceMaps seen = seen_by(added.keyframe);
  for (size_t i = 1; i < all.size(); ++i) {
    Looked& other = all[i];
    if (other.pose.stamp_ns < added.pose.stamp_ns) take(seen, added, &other);
    if (other.pose.stamp_ns > added.pose.stamp_ns) take(seen_by(other.keyframe), other, &added);
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
