#include "window_poses.h"

namespace acmp {
namespace {

/// As the frontend has moved since the keyframe before.
void PredictPose(const WindowKeyframe& before, WindowKeyframe* newest) {
  if (!before.refined_pose) return;
  RigidTransform motion = newest->frame->cam_from_world * before.frame->cam_from_world.inverse();
  newest->placed = {motion * before.placed.cam_from_world, before.placed.scale, before.placed.refined, PoseFit()};
  motion.translation() /= before.placed.scale;
  newest->refined_pose = motion * *before.refined_pose;
  newest->placed.refined->world_from_cam = newest->refined_pose->inverse();
}

}  // namespace

WindowPoses::WindowPoses(const PoseRefinementOptions& options) {
  if (options.refine != RefinePoses::kOff) refiner_ = std::make_unique<PoseRefiner>(options);
}

void WindowPoses::Add(const WindowKeyframePtr& newest, const KeyframeWindow& window) {
  if (!refiner_) return;
  Finish(window);
  if (window.size() > 1) PredictPose(*window.WithLater(1), newest.get());
  Begin(newest, window.size());
}

void WindowPoses::Begin(const WindowKeyframePtr& newest, size_t window_size) {
  found_ = std::async(std::launch::async, [this, frame = newest->frame, range = newest->range, window_size] {
    refiner_->Add(*frame, range);
    while (refiner_->size() > window_size) refiner_->RemoveOldest();
    return refiner_->Refine();
  });
}

void WindowPoses::Finish(const KeyframeWindow& window) {
  if (!found_.valid()) return;
  const PoseRefinement refinement = found_.get();
  if (refinement.checks.contradiction) checks_.contradiction = refinement.checks.contradiction;
  checks_.stamp_offset_s = refinement.checks.stamp_offset_s;
  checks_.distortion_px = refinement.checks.distortion_px;
  for (const RefinedPose& pose : refinement.poses) {
    const WindowKeyframePtr keyframe = window.Find(pose.id);
    if (!keyframe) continue;
    keyframe->refined_pose.reset();
    keyframe->placed = {pose.cam_from_received, static_cast<float>(refinement.scale), std::nullopt,
                        refinement.changed ? pose.refined_fit : pose.received_fit};
    if (!refinement.changed) continue;
    keyframe->refined_pose = pose.cam_from_world;
    keyframe->placed.refined = RefinedCamera{refinement.world, pose.cam_from_world.inverse(), refinement.scale};
  }
}

void WindowPoses::Reset() {
  if (found_.valid()) found_.wait();
  found_ = {};
  checks_ = {};
  if (refiner_) refiner_->Reset();
}

}  // namespace acmp
