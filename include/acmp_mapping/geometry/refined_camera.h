#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

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

/// Where a keyframe's points lie in the world of the received poses.
struct PlacedCamera {
  RigidTransform world_from_cam = RigidTransform::Identity();
  double scale = 1;  ///< of the points' positions, before they are moved
};

/// Places the keyframes of a trajectory, given in the order of their stamps: each world of refined poses is fitted to
/// the received ones along the trajectory (AlignAlong). So a map keeps the form that the images gave it, and goes where
/// the frontend says that it is. A frontend's scale may fall by a fifth and come back within a minute; points that
/// follow it at once do not fit together. None for keyframes of a world that has too few to tell where it lies.
std::vector<std::optional<PlacedCamera>> PlaceAlong(const std::vector<RefinedAndReceived>& keyframes);

}  // namespace acmp
