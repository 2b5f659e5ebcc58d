#pragma once

#include <optional>
#include <vector>

#include "acmp_mapping/common/vector_math.h"

namespace acmp {

// The ray tracer calculates with Vec3d and not with Eigen, whose use of fused multiply-add depends on the target
// machine: the rendered bytes must not.

/// Points origin + t * direction; the direction need not be a unit vector.
struct Ray {
  Vec3d origin;
  Vec3d direction;
};

/// Rotation about the world's z axis by an angle with this cosine and sine.
struct Yaw {
  double cos = 1;
  double sin = 0;
};
inline Vec3d Rotate(const Yaw& yaw, const Vec3d& v) {
  return {yaw.cos * v.x - yaw.sin * v.y, yaw.sin * v.x + yaw.cos * v.y, v.z};
}
inline Vec3d RotateBack(const Yaw& yaw, const Vec3d& v) { return Rotate({yaw.cos, -yaw.sin}, v); }

enum class Shape {
  kBox,       ///< half extents `size`, turned by `yaw`
  kRoom,      ///< a box seen from inside
  kSphere,    ///< radius size.x
  kCylinder,  ///< upright: radius size.x, half height size.z, closed ends
};

struct Solid {
  Shape shape;
  Vec3d center;  ///< m
  Vec3d size;    ///< m
  Yaw yaw;
};

struct Intersection {
  double t = 0;        ///< ray parameter, > 0
  Vec3d normal;        ///< unit, world frame, facing the ray's origin
  Vec3d local;         ///< hit point in the solid's own frame, m
  Vec3d local_normal;  ///< unit, the solid's own frame
};

/// Whether the ray goes through the solid, or starts in it.
bool Meets(const Solid& solid, const Ray& ray);

/// First hit in front of the ray's origin.
std::optional<Intersection> Intersect(const Solid& solid, const Ray& ray);

}  // namespace acmp
