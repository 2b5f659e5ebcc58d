#pragma once

#include <future>
#include <memory>

#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "keyframe_window.h"

namespace acmp {

/// Refines the poses of the window in a thread beside the mapper: those of the first image of each capture, as the
/// others keep their places to it, with distances in the unit of the received poses. What a keyframe has taught is
/// taken in when the next one comes, or when nothing more comes: so results do not depend on the timing, and no map
/// waits for a pose while the input leaves time.
class WindowPoses {
 public:
  /// Where refinement is off poses stay as they are.
  explicit WindowPoses(const PoseRefinementOptions& options);

  /// Takes in what has been found, gives the window's newest capture the poses that follow from it, and begins again
  /// with its first image. Throws what the refinement has thrown; poses then stay.
  void Add(const WindowCapture& newest, const KeyframeWindow& window);

  /// Takes in what has been found. Throws as Add does.
  void Finish(const KeyframeWindow& window);

  void Reset();

  /// The contradiction as it was measured last, the offset of the last window.
  const PoseChecks& checks() const { return checks_; }

 private:
  void Begin(const WindowKeyframe& newest, size_t window_size);

  PoseChecks checks_;
  std::unique_ptr<PoseRefiner> refiner_;  ///< null: poses stay as received
  ReceivedPose newest_;                   ///< that was given to it
  ReceivedPose moved_;                    ///< the newest one that it has kept: the camera had moved
  size_t num_standing_ = 0;               ///< keyframes since then
  /// None: the camera stands since moved_. Last: its thread is gone before what is above.
  std::future<std::optional<PoseRefinement>> found_;
};

}  // namespace acmp
