#pragma once

#include <optional>
#include <string>

#include "bundle.h"

namespace acmp {

/// Of the landmarks, at their anchors, in the unit of bundle.poses; 1 without any.
double TypicalDepth(const Bundle& bundle);

/// Two models of the camera, each at the poses where it fits best: a pinhole, and one with CameraErrors. Sums over the
/// bundles compared.
struct ModelComparison {
  int bundles = 0;
  int sightings = 0;        ///< of held-out landmarks
  double pinhole_cost = 0;  ///< of these sightings (Cauchy, depths fitted)
  double camera_cost = 0;
  double to_pinhole = 0;  ///< from the scene's shape by received poses to that by the pinhole: median of the depths'
                          ///< relative differences, whatever the scale
  double to_camera = 0;   ///< and to that by the camera with errors
  CameraErrors camera;    ///< of the camera, not of a bundle: what the bundles so far have told
};

/// Enough to judge by.
bool IsSure(const ModelComparison& comparison);

/// Whether the camera's errors explain held-out landmarks clearly better than any poses of a pinhole.
bool HasCameraErrors(const ModelComparison& comparison);

/// By how much nearer the pinhole's shape must be than the other's, for AreBent. Of all images: bent poses have 0.04 to
/// 0.56, poses adjusted with a depth sensor 0.69 to 1.8. Of windows of 30, over which a pinhole bends less: 0.16 to
/// 0.31 and 0.64 to 1.9.
constexpr double kNearerOfAll = 0.7, kNearerOfWindows = 0.45;

/// Whether received poses are those of a bundle adjustment that took a camera with errors for a pinhole. They fit well,
/// as the scene's shape has taken the errors up: so it is the shape that tells.
/// @param nearer one of the above
bool AreBent(const ModelComparison& comparison, double nearer);

/// What is learnt while bundles are refined and helps with the next one: the camera's errors, and how far received
/// poses are off.
struct RefinementState {
  int bundles = 0;  ///< refined so far
  CameraErrors camera;
  BundleWeights weights;
  ModelComparison comparison;
  bool bent = false;  ///< received poses: they do not hold refined ones; as AreBentByWindows has told
};

/// Whether received poses are bent by what windows have told. What was found so stays until they tell clearly that it
/// is not so: two windows may be wrong that later ones outweigh.
bool AreBentByWindows(const RefinementState& state);

/// Refines bundle.poses: adjusts the bundle and estimates how far received poses are off, which weighs them
/// (`rounds` times), so that bundle.poses are those of the middle rows of undistorted images. Returns false where the
/// adjustment finds no solution.
/// @param fixed_views so many of the first poses stay
[[nodiscard]] bool RefineBundle(int rounds, int max_iterations, size_t fixed_views, Bundle* bundle,
                                RefinementState* state);

/// Adds a bundle to a comparison. Received poses only place the bundle.
/// Returns the bundle with the poses of the camera with errors; none where an adjustment finds no solution.
std::optional<Bundle> CompareModels(const Bundle& bundle, BundleWeights weights, ModelComparison* comparison);

/// Compares received with refined poses by the matches of held-out landmarks and decides. Leaves the result's poses as
/// received.
/// @param was_changed the decision before, which is kept where the gain is nearly enough
/// @param state has learnt the camera's errors and whether received poses are bent
PoseRefinement JudgeRefinement(const Bundle& bundle, const std::vector<ViewPose>& refined, const RefinementState& state,
                               const PoseRefinementOptions& options, bool was_changed);

/// The result where nothing was tried.
PoseRefinement Unrefined(const Bundle& bundle, std::string reason);

/// Sets the poses of a result.
/// @param refined, placed in the world of the refined poses and in that of the received ones
void SetPoses(const Bundle& bundle, const std::vector<ViewPose>& refined, const std::vector<ViewPose>& placed,
              PoseRefinement* result);

/// PoseChecks::contradiction of an adjusted bundle.
/// @param known_scale as FitSimilarity's, from refined to received poses
std::optional<double> MeasureContradiction(const Bundle& bundle, double known_scale);

/// PoseChecks::stamp_offset_s of an adjusted bundle whose times are stamps in seconds.
std::optional<double> FindStampOffset(const Bundle& bundle);

}  // namespace acmp
