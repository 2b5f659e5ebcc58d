#include "window_poses.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {
namespace {

/// The pose of a capture from that of another one and the received motion since then.
void PredictPose(const ReceivedPose& before, const std::optional<RefinedPlace>& refined, CapturePose* pose) {
  pose->refined.reset();
  pose->fit = {};
  if (refined) pose->refined = refined->Moved(pose->capture_from_world * before.capture_from_world.inverse());
}

/// As the refinement has found it; none: it leaves received poses as they are.
std::optional<RefinedPlace> PlaceFrom(const RefinedPose& pose, const PoseRefinement& refinement) {
  if (!refinement.changed) return std::nullopt;
  return RefinedPlace{refinement.world, pose.cam_from_world, pose.cam_from_received, refinement.scale};
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
  if (window.size() > 1) {
    const CapturePose& before = *window.WithLater(1).pose;
    PredictPose(before, before.refined, newest.pose.get());
  }
  const WindowKeyframe* first = newest.first();
  const bool can_tell = first && HasDepthRange(first->range);
  waiting_.push_back(can_tell ? Candidate{*newest.pose, first->frame, first->range} : Candidate{*newest.pose});
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
      if (capture.pose->id == candidate.received.id) capture.pose->follows = moved_;
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
    CapturePose& pose = *capture.pose;
    const auto own = find(pose.id);
    if (own != poses.end()) {
      pose.refined = PlaceFrom(*own, refinement);
      pose.fit = refinement.changed ? own->refined_fit : own->received_fit;
      continue;
    }
    const bool is_newer = pose.id > poses.back().id;  // its own refinement is to come
    const std::optional<ReceivedPose>& before = is_newer ? moved_ : pose.follows;
    const auto followed = before ? find(before->id) : poses.end();
    if (followed != poses.end()) PredictPose(*before, PlaceFrom(*followed, refinement), &pose);
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
