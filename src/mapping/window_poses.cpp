#include "window_poses.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace acmp {
namespace {

/// The pose of a keyframe from that of another one and the received motion between the two: of the frontend since then,
/// or from one camera to another of the same capture.
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

void WindowPoses::Add(const WindowCapture& newest, const KeyframeWindow& window) {
  if (!refiner_) return;
  std::exception_ptr failure;
  try {
    TakeIn(window);
  } catch (...) {
    failure = std::current_exception();
  }
  const WindowKeyframe& first = *newest.front();
  if (window.size() > 1) {
    const WindowKeyframe& before = *window.WithLater(1).front();
    PredictPose(before.frame->cam_from_world, before.pose, newest.front().get());
    MoveWithFirst(newest);
  }
  waiting_.push_back({{first.frame->id, first.frame->cam_from_world}, first.frame, first.range});
  if (waiting_.size() > kMaxWaiting) {
    Candidate& oldest = *(waiting_.end() - kMaxWaiting - 1);
    left_out_ += oldest.frame ? 1 : 0;
    oldest.frame.reset();
  }
  Begin(window.size());
  if (failure) std::rethrow_exception(failure);
}

void WindowPoses::Update(const KeyframeWindow& window) {
  TakeIn(window);
  Begin(window.size());
}

void WindowPoses::Finish(const KeyframeWindow& window) {
  while (found_.valid()) {
    found_.wait();
    Update(window);
  }
}

void WindowPoses::Begin(size_t window_size) {
  if (found_.valid() || waiting_.empty()) return;
  found_ = std::async(std::launch::async, [this, window_size, candidates = std::exchange(waiting_, {})]() mutable {
    Found found;
    const auto attempt = [&found](const auto& work) {
      try {
        work();
      } catch (...) {
        if (!found.failure) found.failure = std::current_exception();
      }
    };
    bool any_kept = false;
    for (Candidate& candidate : candidates) {
      if (!candidate.frame) continue;
      attempt([&] {
        candidate.is_kept = refiner_->Add(*candidate.frame, candidate.range);
        candidate.stands = !candidate.is_kept;
      });
      any_kept = any_kept || candidate.is_kept;
      candidate.frame.reset();
    }
    while (refiner_->size() > window_size) refiner_->RemoveOldest();
    if (any_kept) attempt([&] { found.refinement = refiner_->Refine(); });
    found.candidates = std::move(candidates);
    return found;
  });
}

void WindowPoses::TakeIn(const KeyframeWindow& window) {
  if (!found_.valid()) return;
  if (live_ && found_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  const Found found = found_.get();
  for (const Candidate& candidate : found.candidates) {
    if (candidate.is_kept) {
      moved_ = candidate.received;
      num_standing_ = 0;
      continue;
    }
    if (candidate.stands) ++num_standing_;
    for (const WindowCapture& capture : window) {
      WindowKeyframe& keyframe = *capture.front();
      if (keyframe.frame->id == candidate.received.id) keyframe.follows = moved_;
    }
  }
  if (!found.refinement.poses.empty()) {
    const std::optional<double> contradiction_before = checks_.contradiction;
    checks_ = found.refinement.checks;
    if (!checks_.contradiction) checks_.contradiction = contradiction_before;
    Place(window, found.refinement);
  }
  if (num_standing_ >= kContradictionImages) checks_.contradiction = 0;  // of the last images
  if (found.failure) std::rethrow_exception(found.failure);
}

void WindowPoses::Place(const KeyframeWindow& window, const PoseRefinement& refinement) const {
  const std::vector<RefinedPose>& poses = refinement.poses;
  const auto find = [&](int64_t id) {
    return std::find_if(poses.begin(), poses.end(), [id](const RefinedPose& pose) { return pose.id == id; });
  };
  for (const WindowCapture& capture : window) {
    WindowKeyframe& keyframe = *capture.front();
    const auto own = find(keyframe.frame->id);
    if (own != poses.end()) {
      keyframe.pose = PoseFrom(*own, refinement);
    } else {
      const bool is_newer = keyframe.frame->id > poses.back().id;  // its own refinement is to come
      const std::optional<ReceivedPose>& before = is_newer ? moved_ : keyframe.follows;
      const auto followed = before ? find(before->id) : poses.end();
      if (followed == poses.end()) continue;
      PredictPose(before->cam_from_world, PoseFrom(*followed, refinement), &keyframe);
    }
    MoveWithFirst(capture);
  }
}

void WindowPoses::Reset() {
  if (found_.valid()) found_.wait();
  found_ = {};
  waiting_.clear();
  moved_.reset();
  num_standing_ = 0;
  left_out_ = 0;
  checks_ = {};
  if (refiner_) refiner_->Reset();
}

}  // namespace acmp
