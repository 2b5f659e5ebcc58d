#include "window_poses.h"

#include <algorithm>

namespace acmp {
namespace {

/// As the frontend has moved since another keyframe, or another camera of the same capture lies to it.
void PredictPose(const RigidTransform& received_before, const MatchingPose& before, WindowKeyframe* keyframe) {
  const RigidTransform& received = keyframe->frame->cam_from_world;
  keyframe->pose = {std::nullopt, {received, 1, std::nullopt, PoseFit()}};
  if (!before.refined) return;
  RigidTransform motion = received * received_before.inverse();
  PlacedPose placed = {motion * before.placed.cam_from_world, before.placed.scale, before.placed.refined, PoseFit()};
  motion.translation() /= before.placed.scale;
  const RigidTransform refined = motion * *before.refined;
  placed.refined->world_from_cam = refined.inverse();
  keyframe->pose = {refined, placed};
}

/// The other images of a capture where the first one's pose puts them.
void MoveWithFirst(const WindowCapture& capture) {
  const WindowKeyframe& first = *capture.front();
  for (size_t i = 1; i < capture.size(); ++i) {
    PredictPose(first.frame->cam_from_world, first.pose, capture[i].get());
    capture[i]->pose.placed.fit = first.pose.placed.fit;
  }
}

/// As the refinement has found it.
MatchingPose PoseFrom(const RefinedPose& pose, const PoseRefinement& refinement) {
  const auto scale = static_cast<float>(refinement.scale);
  if (!refinement.changed) return {std::nullopt, {pose.cam_from_received, scale, std::nullopt, pose.received_fit}};
  const RefinedCamera camera = {refinement.world, pose.cam_from_world.inverse(), refinement.scale};
  return {pose.cam_from_world, {pose.cam_from_received, scale, camera, pose.refined_fit}};
}

}  // namespace

WindowPoses::WindowPoses(const PoseRefinementOptions& options) {
  if (options.refine != RefinePoses::kOff) refiner_ = std::make_unique<PoseRefiner>(options);
}

void WindowPoses::Add(const WindowCapture& newest, const KeyframeWindow& window) {
  if (!refiner_) return;
  Finish(window);
  if (window.size() > 1) {
    const WindowKeyframe& before = *window.WithLater(1).front();
    PredictPose(before.frame->cam_from_world, before.pose, newest.front().get());
    MoveWithFirst(newest);
  }
  Begin(*newest.front(), window.size());
}

void WindowPoses::Begin(const WindowKeyframe& newest, size_t window_size) {
  newest_ = {newest.frame->id, newest.frame->cam_from_world};
  found_ =
      std::async(std::launch::async,
                 [this, frame = newest.frame, range = newest.range, window_size]() -> std::optional<PoseRefinement> {
                   if (!refiner_->Add(*frame, range)) return std::nullopt;
                   while (refiner_->size() > window_size) refiner_->RemoveOldest();
                   return refiner_->Refine();
                 });
}

void WindowPoses::Finish(const KeyframeWindow& window) {
  if (!found_.valid()) return;
  const std::optional<PoseRefinement> refinement = found_.get();
  if (!refinement) {
    for (const WindowCapture& capture : window) {
      if (capture.front()->frame->id == newest_.id) capture.front()->stands_since = moved_;
    }
    if (++num_standing_ >= kContradictionImages) checks_.contradiction = 0;  // of the last images
    return;
  }
  moved_ = newest_;
  num_standing_ = 0;
  const std::optional<double> contradiction_before = checks_.contradiction;
  checks_ = refinement->checks;
  if (!checks_.contradiction) checks_.contradiction = contradiction_before;
  for (const WindowCapture& capture : window) {
    const WindowKeyframePtr& keyframe = capture.front();
    const int64_t id = keyframe->stands_since ? keyframe->stands_since->id : keyframe->frame->id;
    const auto& poses = refinement->poses;
    const auto pose = std::find_if(poses.begin(), poses.end(), [id](const RefinedPose& p) { return p.id == id; });
    if (pose == poses.end()) continue;
    const MatchingPose found = PoseFrom(*pose, *refinement);
    if (!keyframe->stands_since) keyframe->pose = found;
    if (keyframe->stands_since) PredictPose(keyframe->stands_since->cam_from_world, found, keyframe.get());
    MoveWithFirst(capture);
  }
}

void WindowPoses::Reset() {
  if (found_.valid()) found_.wait();
  found_ = {};
  num_standing_ = 0;
  checks_ = {};
  if (refiner_) refiner_->Reset();
}

}  // namespace acmp
