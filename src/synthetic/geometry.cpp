#include "world.h"

#include <limits>
#include <utility>

namespace acmp {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Interval of the ray inside a convex solid and the outward normals where it enters and leaves.
struct Crossing {
  double enter = -kInfinity;
  double leave = kInfinity;
  Vec3d enter_normal = {0, 0, 0};
  Vec3d leave_normal = {0, 0, 0};
};

// Cuts the interval by the slab |origin + t direction| <= half along `axis`; false when nothing remains.
bool CutBySlab(double origin, double direction, double half, const Vec3d& axis, Crossing* crossing) {
  if (direction == 0) return std::abs(origin) <= half;
  double near = (-half - origin) / direction;
  double far = (half - origin) / direction;
  Vec3d near_normal = -1.0 * axis;
  Vec3d far_normal = axis;
  if (near > far) {
    std::swap(near, far);
    std::swap(near_normal, far_normal);
  }
  if (near > crossing->enter) {
    crossing->enter = near;
    crossing->enter_normal = near_normal;
  }
  if (far < crossing->leave) {
    crossing->leave = far;
    crossing->leave_normal = far_normal;
  }
  return crossing->enter < crossing->leave;
}

bool CrossBox(const Vec3d& half, const Ray& ray, Crossing* crossing) {
  return CutBySlab(ray.origin.x, ray.direction.x, half.x, {1, 0, 0}, crossing) &&
         CutBySlab(ray.origin.y, ray.direction.y, half.y, {0, 1, 0}, crossing) &&
         CutBySlab(ray.origin.z, ray.direction.z, half.z, {0, 0, 1}, crossing);
}

// Cuts by |p|^2 <= radius^2 with the quadratic a t^2 + 2 b t + c. `axis_scale` is 0 to leave z out (a cylinder).
bool CutByRound(const Ray& ray, double radius, double axis_scale, Crossing* crossing) {
  const Vec3d o = {ray.origin.x, ray.origin.y, axis_scale * ray.origin.z};
  const Vec3d d = {ray.direction.x, ray.direction.y, axis_scale * ray.direction.z};
  const double a = Dot(d, d);
  const double b = Dot(o, d);
  const double c = Dot(o, o) - radius * radius;
  if (a == 0) return c <= 0;
  const double discriminant = b * b - a * c;
  if (discriminant <= 0) return false;
  const double root = std::sqrt(discriminant);
  const double near = (-b - root) / a;
  const double far = (-b + root) / a;
  if (near > crossing->enter) {
    crossing->enter = near;
    crossing->enter_normal = (1.0 / radius) * (o + near * d);
  }
  if (far < crossing->leave) {
    crossing->leave = far;
    crossing->leave_normal = (1.0 / radius) * (o + far * d);
  }
  return crossing->enter < crossing->leave;
}

bool CrossSolid(const Solid& solid, const Ray& local, Crossing* crossing) {
  switch (solid.shape) {
    case Shape::kBox:
    case Shape::kRoom:
      return CrossBox(solid.size, local, crossing);
    case Shape::kSphere:
      return CutByRound(local, solid.size.x, 1.0, crossing);
    case Shape::kCylinder:
      return CutByRound(local, solid.size.x, 0.0, crossing) &&
             CutBySlab(local.origin.z, local.direction.z, solid.size.z, {0, 0, 1}, crossing);
  }
  return false;
}

}  // namespace

bool Meets(const Solid& solid, const Ray& ray) {
  const Ray local = {RotateBack(solid.yaw, ray.origin - solid.center), RotateBack(solid.yaw, ray.direction)};
  Crossing crossing;
  return CrossSolid(solid, local, &crossing) && crossing.leave > 0;
}

std::optional<Intersection> Intersect(const Solid& solid, const Ray& ray) {
  const Ray local = {RotateBack(solid.yaw, ray.origin - solid.center), RotateBack(solid.yaw, ray.direction)};
  Crossing crossing;
  if (!CrossSolid(solid, local, &crossing)) return std::nullopt;
  const bool from_inside = solid.shape == Shape::kRoom;
  const double t = from_inside ? crossing.leave : crossing.enter;
  if (!(t > 0)) return std::nullopt;
  const Vec3d local_normal = from_inside ? -1.0 * crossing.leave_normal : crossing.enter_normal;
  return Intersection{t, Rotate(solid.yaw, local_normal), local.origin + t * local.direction, local_normal};
}

}  // namespace acmp
