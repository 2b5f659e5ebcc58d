#pragma once

#include <cstddef>
#include <deque>
#include <exception>
#include <future>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "keyframe_window.h"

namespace acmp {

/// Refines the poses of the window's captures in a thread beside the mapper, by their first images. A capture without
/// that one follows the one before. What keyframes have taught is taken in
/// - when the next one comes, or when nothing more comes: so results do not depend on the timing;
/// - live, when it is ready: no keyframe waits for it. Those that come meanwhile follow the one before them by the
///   received motion, and are refined together next. Of more than kMaxWaiting the oldest are left out: they go on
///   following.
class WindowPoses {
 public:
  /// @param refiner null: poses stay as they are
  WindowPoses(std::unique_ptr<PoseRefiner> refiner, bool live) : live_(live), refiner_(std::move(refiner)) {}

  /// Takes in what is due, gives the window's newest capture the pose that follows from it, and begins again with its
  /// first image. Throws what the refinement has thrown; poses then stay.
  void Add(const WindowCapture& newest, const KeyframeWindow& window);

  /// Takes in what is due, and goes on with what waits. Throws as Add does.
  void Update(const KeyframeWindow& window);

  /// Takes in all that can be found. Throws as Add does.
  void Finish(const KeyframeWindow& window);

  void Reset();

  /// The contradiction as it was measured last, the offset of the last window.
  const PoseChecks& checks() const { return checks_; }
  uint64_t left_out() const { return left_out_; }  ///< keyframes, since the last Reset

  static constexpr size_t kMaxWaiting = 8;  ///< as many as the refiner's newest poses that it has not fixed yet

 private:
  /// A keyframe on its way through the refiner.
  struct Candidate {
    ReceivedPose received;
    FramePtr frame = nullptr;  ///< null: left out, or there is none
    DepthRange range = {};
    bool is_kept = false;  ///< by the refiner
    bool stands = false;   ///< not kept: the camera has not moved since the one before
  };
  struct Found {
    std::vector<Candidate> candidates;
    PoseRefinement refinement;   ///< of the window, if one was kept
    std::exception_ptr failure;  ///< the first
  };
  void Begin(size_t window_size);
  void TakeIn(const KeyframeWindow& window);
  void Place(const KeyframeWindow& window, const PoseRefinement& refinement) const;

  const bool live_;
  std::unique_ptr<PoseRefiner> refiner_;
  PoseChecks checks_;
  std::vector<Candidate> waiting_;
  std::optional<ReceivedPose> moved_;  ///< the newest one that the refiner has kept: the camera had moved
  size_t num_standing_ = 0;            ///< keyframes since then
  uint64_t left_out_ = 0;
  std::future<Found> found_;  ///< last: its thread is gone before what is above
};

}  // namespace acmp
