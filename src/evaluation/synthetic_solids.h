#pragma once

#include "synthetic_world.h"

namespace acmp {

// Angles with rational cosine and sine (Pythagorean triples), exact without libm.
inline constexpr Yaw kYaw13 = {40.0 / 41.0, 9.0 / 41.0};
inline constexpr Yaw kYaw23 = {12.0 / 13.0, 5.0 / 13.0};
inline constexpr Yaw kYawMinus28 = {15.0 / 17.0, -8.0 / 17.0};
inline constexpr Yaw kYaw37 = {4.0 / 5.0, 3.0 / 5.0};

inline WorldObject Box(const Vec3d& center, const Vec3d& half, const Material& material, const Yaw& yaw = {}) {
  return {{Shape::kBox, center, half, yaw}, material};
}

inline WorldObject Cylinder(const Vec3d& center, double radius, double half_height, const Material& material) {
  return {{Shape::kCylinder, center, {radius, radius, half_height}, {}}, material};
}

inline WorldObject Sphere(const Vec3d& center, double radius, const Material& material) {
  return {{Shape::kSphere, center, {radius, radius, radius}, {}}, material};
}

}  // namespace acmp
