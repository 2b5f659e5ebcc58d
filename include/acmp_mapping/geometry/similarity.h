#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// x -> rigid * (scale * x): from one world of a monocular camera to another, or from a camera's points to a world.
struct Similarity {
  RigidTransform rigid = RigidTransform::Identity();
  double scale = 1;

  /// Pose of a camera in the new world, given that in the old one.
  RigidTransform Moved(const RigidTransform& world_from_cam) const;
};

/// A camera's pose in two worlds.
struct PosePair {
  RigidTransform from = RigidTransform::Identity();  ///< world_from_cam
  RigidTransform to = RigidTransform::Identity();
};

/// Fewer poses do not tell scale and place of a trajectory.
constexpr size_t kMinForSimilarity = 4;

/// The similarity that takes poses of a trajectory, in its order, from their first world to their second: mean of the
/// rotations and of the centres, and the scale by least squares of the baselines from each pose to the fourth after it.
/// Least squares of all centres would take a drift of the trajectory for a scale (1 % for a headset's tracker whose
/// baselines are right to 0.1 %). A trajectory may be straight, so that its centres alone do not tell the rotation. The
/// identity for fewer than kMinForSimilarity poses; scale 1 where the baselines do not tell it.
Similarity FitSimilarity(const std::vector<PosePair>& poses);

/// How far along a trajectory AlignAlong looks, poses to each side: for the place, and for the scale.
constexpr size_t kAlignmentReach = 60, kScaleReach = 480;

/// For each pose of a trajectory the similarity that fits it and those around it, whose weight falls linearly to none
/// at kAlignmentReach poses; for the scale, whose changes are the frontend's errors rather than the refinement's, at
/// kScaleReach. So the trajectory follows the second world, which has another drift, and neighbours, which see the same
/// surfaces, are moved alike: they come to lie 0.3 to 1 cm apart over ten keyframes of recorded frontends. Takes time
/// in proportion to the number of poses.
/// @param scale where it is known
std::vector<Similarity> AlignAlong(const std::vector<PosePair>& poses, std::optional<double> scale = std::nullopt);

/// Where a keyframe lies in a world of refined poses. That world carries its own scale and place on from keyframe to
/// keyframe, and drifts away from the received poses' world.
struct RefinedCamera {
  uint64_t world = 0;  ///< which one: poses of different numbers have nothing to do with each other
  RigidTransform world_from_cam = RigidTransform::Identity();
  /// By which the keyframe's maps and points were multiplied, so as to have the size of what is around it in the
  /// received poses' world; > 0.
  double scale = 1;
};

/// A keyframe as it is known in both worlds.
struct RefinedAndReceived {
  RefinedCamera refined;
  RigidTransform received = RigidTransform::Identity();  ///< world_from_cam
};

/// A keyframe on a trajectory.
struct TrajectoryKeyframe {
  int64_t capture = 0;  ///< the same for keyframes that were taken together (faces of a wide image)
  RefinedAndReceived poses;
};

/// Where a trajectory's keyframes and their points lie in the world of the received poses, given in its order: each
/// world of refined poses is fitted to the received ones along the trajectory (AlignAlong), of whose captures each
/// counts once. So a map keeps the form that the images gave it, and goes where the frontend says that it is. A
/// frontend's scale may fall by a fifth and come back within a minute; points that follow it at once do not fit
/// together. None for keyframes of a world that has too few captures to tell where it lies.
std::vector<std::optional<Similarity>> PlaceAlong(const std::vector<TrajectoryKeyframe>& keyframes);

}  // namespace acmp
