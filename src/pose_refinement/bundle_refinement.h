#pragma once

#include "bundle.h"
#include "bundle_adjustment.h"

namespace acmp {

/// Of the landmarks, at their anchors, in the unit of bundle.poses; 1 without any.
double TypicalDepth(const Bundle& bundle);

/// What is learnt while bundles are refined and helps with the next one: the camera's errors, and how far received
/// poses are off.
struct RefinementState {
  int bundles = 0;  ///< refined so far
  CameraErrors camera;
  BundleWeights weights;
};

/// Refines bundle.poses: adjusts the bundle and estimates how far received poses are off, which weighs them
/// (`rounds` times), so that bundle.poses are those of the middle rows of undistorted images. Returns false where the
/// adjustment finds no solution.
/// @param fixed_views so many of the first poses stay
[[nodiscard]] bool RefineBundle(int rounds, int max_iterations, size_t fixed_views, Bundle* bundle,
                                RefinementState* state);

/// Compares received with refined poses by the matches of held-out landmarks and decides.
/// @param was_changed the decision before, which is kept where the gain is nearly enough
PoseRefinement JudgeRefinement(const Bundle& bundle, const std::vector<int64_t>& ids,
                               const std::vector<RigidTransform>& received, const std::vector<ViewPose>& refined,
                               const CameraErrors& camera, const PoseRefinementOptions& options, bool was_changed);

/// Whether a landmark is held out: the same for the same anchor and pixel, one in five.
bool IsHeldOut(int64_t anchor_id, const Eigen::Vector2d& pixel);

/// The result where nothing was tried.
PoseRefinement Unrefined(const std::vector<int64_t>& ids, const std::vector<RigidTransform>& received,
                         std::string reason);

}  // namespace acmp
