#pragma once

#include <cmath>
#include <optional>
#include <vector>

namespace acmp {

/// Plain double arithmetic for the ray tracer. Not Eigen, whose use of fused multiply-add depends on the target
/// machine: the rendered bytes must not.
struct Vec3d {
  double x, y, z;
};

inline Vec3d operator+(const Vec3d& a, const Vec3d& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3d operator-(const Vec3d& a, const Vec3d& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3d operator*(double s, const Vec3d& a) { return {s * a.x, s * a.y, s * a.z}; }
inline double Dot(const Vec3d& a, const Vec3d& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3d Cross(const Vec3d& a, const Vec3d& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double Norm(const Vec3d& a) { return std::sqrt(Dot(a, a)); }
inline Vec3d Normalized(const Vec3d& a) { return (1.0 / Norm(a)) * a; }

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

/// First hit in front of the ray's origin.
std::optional<Intersection> Intersect(const Solid& solid, const Ray& ray);

}  // namespace acmp
