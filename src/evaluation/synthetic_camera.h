#pragma once

#include <cstdint>
#include <variant>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "synthetic_geometry.h"

namespace acmp {

/// Camera centre and axes in the world (x right, y down, z forward).
struct CameraPose {
  Vec3d center;
  Vec3d right, down, forward;
};

/// Arcs around a target, one above the other.
struct HandHeldPath {
  Vec3d target;         ///< m
  double orbit_m;       ///< horizontal distance kept from it
  double tan_per_step;  ///< tangent of half the angle between two keyframes, seen from the target
};

/// Along +y and back again (looking along +y all the while), at the height of a camera on a vehicle.
struct StraightPath {
  Vec3d start;    ///< m
  double step_m;  ///< between two keyframes
  int steps;      ///< keyframes until it turns back
};

using CameraPath = std::variant<HandHeldPath, StraightPath>;

/// Pose of keyframe `index` of `count`, with the slow sway of a hand or a vehicle.
CameraPose PoseOnPath(const CameraPath& path, int index, int count, uint32_t seed);

/// 60 degrees of horizontal field of view; principal point a little off the centre, as real ones are.
PinholeCamera SyntheticCamera(int width, int height);

/// Ray through a pixel whose parameter t is the depth z.
Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row);

}  // namespace acmp
