#include "world.h"

#include <algorithm>
#include <cmath>
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

// Whether the ray goes through the solid, or starts in it.
bool Meets(const Solid& solid, const Ray& ray) {
  const Ray local = {RotateBack(solid.yaw, ray.origin - solid.center), RotateBack(solid.yaw, ray.direction)};
  Crossing crossing;
  return CrossSolid(solid, local, &crossing) && crossing.leave > 0;
}

// First hit in front of the ray's origin.
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

ColorD PaintOf(const WallPaint& paint, const Vec3d& normal) {
  if (normal.z > 0.5) return paint.floor;
  if (normal.z < -0.5) return paint.ceiling;
  return std::abs(normal.x) > 0.5 ? paint.walls_x : paint.walls_y;
}

// Phong's highlight with an exponent of 32, half as bright 12 degrees off the mirrored lamp: varnish, satin paper.
// White.
double Highlight(double gloss, const Vec3d& normal, const Vec3d& to_lamp, const Ray& ray) {
  const Vec3d light = Normalized(to_lamp);
  const Vec3d mirrored = 2.0 * Dot(normal, light) * normal - light;
  double cosine = std::max(0.0, -Dot(mirrored, Normalized(ray.direction)));
  for (int i = 0; i < 5; ++i) cosine *= cosine;  // to the power of 32 without libm
  return 255.0 * gloss * cosine;
}

// Paler towards the horizon, with faint clouds; by direction alone, as all of it is infinitely far.
ColorD SkyColor(const Vec3d& direction, uint32_t seed) {
  const Vec3d d = Normalized(direction);
  const double up = std::clamp(d.z, 0.0, 1.0);
  const double cloud = ValueNoise(seed * 7919u, {5 * d.x, 5 * d.y, 12 * d.z});
  const double pale = std::clamp(1.0 - 1.6 * up + 0.25 * (cloud - 0.5), 0.0, 1.0);
  return {120 + 110 * pale, 165 + 70 * pale, 222 + 18 * pale};
}

constexpr double kShareOfSpeed = 0.3;

/// Ahead of the camera, m.
struct Place {
  double ahead, right, down;
  Vec3d half;  ///< extents
};

Place PlaceOf(SyntheticPlace place) {
  if (place == SyntheticPlace::kStreet) return {8.0, 1.0, 0.4, {0.9, 0.5, 1.0}};  // as large as a car
  return {1.3, 0.2, 0.1, {0.17, 0.12, 0.3}};
}

Vec3d Level(const Vec3d& v) { return {v.x, v.y, 0}; }

}  // namespace

WorldHit Trace(const SyntheticWorld& world, const Ray& ray, const std::vector<size_t>* objects) {
  WorldHit first;
  first.where.t = kInfinity;
  const size_t count = objects ? objects->size() : world.objects.size();
  for (size_t k = 0; k < count; ++k) {
    const size_t i = objects ? (*objects)[k] : k;
    const auto hit = Intersect(world.objects[i].solid, ray);
    if (!hit || hit->t >= first.where.t) continue;
    first.where = *hit;
    first.object = i;
  }
  const WorldObject& object = world.objects[first.object];
  first.low_texture = object.material.pattern == Pattern::kBlank;
  first.sky = world.sky && object.solid.shape == Shape::kRoom;
  return first;
}

std::vector<size_t> ObjectsNear(const SyntheticWorld& world, const Ray& ray, double margin) {
  std::vector<size_t> near;
  for (size_t i = 0; i < world.objects.size(); ++i) {
    // Grown by the margin, the solid holds every point that lies within the margin of a point of its own.
    Solid grown = world.objects[i].solid;
    grown.size = grown.size + Vec3d{margin, margin, margin};
    if (Meets(grown, ray)) near.push_back(i);
  }
  return near;
}

Label LabelOf(const SyntheticWorld& world, const WorldHit& hit) {
  if (hit.sky) return kSky;
  const WorldObject& object = world.objects[hit.object];
  if (object.solid.shape != Shape::kRoom) return object.label;
  const double up = hit.where.normal.z;
  return up > 0.5 ? kFloor : up < -0.5 ? kCeiling : kWall;
}

ColorD LitColor(const SyntheticWorld& world, const WorldHit& hit, const Ray& ray, uint32_t seed) {
  if (hit.sky) return SkyColor(ray.direction, seed);
  const WorldObject& object = world.objects[hit.object];
  const Vec3d& normal = hit.where.normal;
  const bool is_room = object.solid.shape == Shape::kRoom;
  const ColorD paint = is_room ? PaintOf(world.wall_paint, normal)
                               : TextureColor(object.material, seed * 7919u + static_cast<uint32_t>(hit.object) * 101u,
                                              hit.where.local, hit.where.local_normal);
  // Mostly diffuse light: a faint gradient on walls and floor, edges of boxes still show.
  const Vec3d point = ray.origin + hit.where.t * ray.direction;
  const double facing = std::max(0.0, Dot(normal, Normalized(world.lamp - point)));
  const double light = is_room ? 0.92 + 0.08 * facing : 0.72 + 0.28 * facing;
  const double shine =
      object.material.gloss > 0 ? Highlight(object.material.gloss, normal, world.lamp - point, ray) : 0;
  return {light * paint.r + shine, light * paint.g + shine, light * paint.b + shine};
}

SyntheticWorld WithMovingObject(const SyntheticWorld& world, int index, const SyntheticSceneOptions& options) {
  const auto pose = [&](int i) { return PoseOnPath(world.path, i, options.keyframes, options.seed); };
  const CameraPose middle = pose(options.keyframes / 2);
  const Place place = PlaceOf(options.place);
  const Vec3d from_camera = place.ahead * Normalized(Level(middle.forward)) +
                            place.right * Normalized(Level(middle.right)) - Vec3d{0, 0, place.down};
  const Vec3d moved = kShareOfSpeed * Level(pose(index).center - middle.center);
  const Material material = {Pattern::kMosaic, {70, 40, 90}, {236, 200, 120}};
  SyntheticWorld with = world;
  with.objects.push_back(Box(middle.center + from_camera + moved, place.half, material, kYaw23));
  return with;
}

Mask MaskOfLastObject(const SyntheticWorld& world, const PinholeCamera& camera, const CameraPose& pose,
                      const ImagingModel& imaging) {
  constexpr double kPixelArea = 1;  // px
  const double turn_px = LargestTurn(imaging) * std::max(camera.fx, camera.fy);
  const int margin = static_cast<int>(std::ceil(kPixelArea + turn_px)) + PsfBorder(imaging);
  // All pixels that show it, also beyond the image: what is just outside is mixed into the rim.
  const int width = camera.width + 2 * margin, height = camera.height + 2 * margin;
  Image<unsigned char> shows(width, height);
  ForEachPixel(width, height, [&](int col, int row) {
    const WorldHit hit = Trace(world, PixelRay(camera, pose, col - margin, row - margin));
    shows(col, row) = hit.object + 1 == world.objects.size() ? 1 : 0;
  });
  Mask mask(camera.width, camera.height, 255);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) {
    for (int r = row; r <= row + 2 * margin; ++r) {
      for (int c = col; c <= col + 2 * margin; ++c) {
        if (shows(c, r) != 0) mask(col, row) = 0;
      }
    }
  });
  return mask;
}

}  // namespace acmp
