#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/pose_refinement/pose_refinement.h"

namespace acmp {

/// That a PoseRefiner uses at once; two more compare models of the camera now and then.
constexpr int kPoseRefinementThreads = 4;

/// Refines the poses of a sliding window of keyframes. Landmarks are carried over from keyframe to keyframe, so that a
/// new one costs little. Used by one thread at a time; the result does not depend on the number of cores. Virtual for
/// tests.
class PoseRefiner {
 public:
  /// Throws InvalidInputError for bad options.
  /// @param live comparisons of camera models are taken in when they are ready, so that nothing waits for one; else
  ///   always as many keyframes later, so that the same keyframes give the same poses
  explicit PoseRefiner(const PoseRefinementOptions& options, bool live = false);
  virtual ~PoseRefiner();

  /// Adds the newest keyframe: finds known landmarks in it, and new ones. Nothing of the frame is kept but a copy of
  /// its grey values in 8 bits. False, and nothing is kept, where the camera stands by its pose and its image: from one
  /// place landmarks have no depth, and the window would forget those that have one. Throws InvalidInputError for a bad
  /// pose, camera or range, and for an id or (where there are stamps) a stamp that does not ascend.
  /// @param range where new landmarks are looked for
  virtual bool Add(const Frame& frame, const DepthRange& range);

  /// Forgets the oldest keyframe and the landmarks first seen there. Throws InvalidInputError where there is none.
  void RemoveOldest();

  /// Poses of the keyframes in the window, oldest first, and how well they fit. Fewer than three keyframes or few
  /// matches: as received, with the reason.
  virtual PoseRefinement Refine();

  /// Forgets everything, also what was learnt about the camera. What comes then is in another world
  /// (PoseRefinement::world).
  void Reset();

  /// Keyframes in the window.
  size_t size() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Depth range of a frame of which no landmarks are known: corners are looked for in other frames along their rays, and
/// the depths found give the range as those of landmarks do (DepthRangeFromLandmarks). None while too few are found, or
/// while most of them hardly move between the frames: the camera has not moved sideways far enough.
///
/// Tries the first of the others, then the first two, four and eight: what is near the camera is seen only by those
/// that are near as well.
/// @param others nearest first; at most 8 are of use; their poses are the received ones
std::optional<DepthRange> DepthRangeFromMatches(const Frame& frame, const std::vector<FramePtr>& others);

}  // namespace acmp
