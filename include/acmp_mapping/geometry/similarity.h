#pragma once

#include <cstddef>
#include <vector>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// x -> rigid * (scale * x): from one world of a monocular camera to another.
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

/// The similarity that takes poses from their first world to their second: mean of the rotations, least squares of the
/// centres along them. A trajectory may be straight, so that its centres alone do not tell the rotation. The identity
/// for fewer than kMinForSimilarity poses; scale 1 where the centres do not tell it.
Similarity FitSimilarity(const std::vector<PosePair>& poses);

/// How far along a trajectory AlignAlong looks, poses to each side.
constexpr size_t kAlignmentReach = 120;

/// For each pose of a trajectory the similarity that fits it and those around it, whose weight falls linearly to none
/// at kAlignmentReach poses. So the trajectory follows the second world, which has another drift, and neighbours, which
/// see the same surfaces, are moved alike. Takes time in proportion to the number of poses.
std::vector<Similarity> AlignAlong(const std::vector<PosePair>& poses);

}  // namespace acmp
