#include "synthetic_world.h"

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
    if (Intersect(grown, ray)) near.push_back(i);
  }
  return near;
}

ColorD LitColor(const SyntheticWorld& world, const WorldHit& hit, const Ray& ray, uint32_t seed) {
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
  return {light * paint.r, light * paint.g, light * paint.b};
}

}  // namespace acmp
