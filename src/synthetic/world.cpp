#include "world.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace acmp {
namespace {

void KeepFirst(const SyntheticWorld& world, size_t object, const Ray& ray, WorldHit* first) {
  const auto hit = Intersect(world.objects[object].solid, ray);
  if (!hit || hit->t >= first->where.t) return;
  first->where = *hit;
  first->object = object;
  first->low_texture = world.objects[object].material.pattern == Pattern::kBlank;
  first->sky = world.sky && world.objects[object].solid.shape == Shape::kRoom;
}

WorldHit Nothing() {
  WorldHit hit;
  hit.where.t = std::numeric_limits<double>::infinity();
  return hit;
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

}  // namespace

WorldHit Trace(const SyntheticWorld& world, const Ray& ray) {
  WorldHit first = Nothing();
  for (size_t i = 0; i < world.objects.size(); ++i) KeepFirst(world, i, ray, &first);
  return first;
}

WorldHit Trace(const SyntheticWorld& world, const Ray& ray, const std::vector<size_t>& objects) {
  WorldHit first = Nothing();
  for (const size_t i : objects) KeepFirst(world, i, ray, &first);
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

}  // namespace acmp
