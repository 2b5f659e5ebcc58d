#pragma once

#include <cstdint>
#include <vector>

#include "synthetic_camera.h"
#include "synthetic_geometry.h"
#include "synthetic_texture.h"

namespace acmp {

struct WorldObject {
  Solid solid;
  Material material;
};

/// The surfaces of the kRoom solid are painted apart, so that their edges can be seen.
struct WallPaint {
  ColorD floor, ceiling, walls_x, walls_y;  ///< walls_x: those across the x axis
};

/// What is rendered. World frame: metres, z up, floor at z = 0, the camera looks along +y. The geometry does not depend
/// on a seed.
struct SyntheticWorld {
  std::vector<WorldObject> objects;  ///< one of them the room around all others
  WallPaint wall_paint;
  Vec3d lamp;
  double diameter_m;  ///< no ray inside the room is longer
  CameraPath path;
  bool sky = false;  ///< the room is not there: what it shows is infinitely far, with the colours of a sky
};

/// Blank walls and floor with trims, textured furniture; 5 degrees between keyframes.
const SyntheticWorld& RoomWorld();

/// Blank walls and floor without trims, thin rods and cables, equal tiles; 4 degrees between keyframes.
const SyntheticWorld& OfficeWorld();

/// Houses along a street under a sky, driven along; 45 cm between keyframes.
const SyntheticWorld& StreetWorld();

/// What a ray sees first. Every ray from inside the room sees something.
struct WorldHit {
  Intersection where;
  size_t object = 0;  ///< index into the world's objects
  bool low_texture = false;
  bool sky = false;  ///< nothing is there; `where` is then that of the room around all
};
WorldHit Trace(const SyntheticWorld& world, const Ray& ray);

/// Indices of the objects that a ray within `margin` metres of this one, up to the far wall, can meet; the room itself
/// is always one. Tracing a pixel's many rays against these alone gives the same hits several times faster.
std::vector<size_t> ObjectsNear(const SyntheticWorld& world, const Ray& ray, double margin);
WorldHit Trace(const SyntheticWorld& world, const Ray& ray, const std::vector<size_t>& objects);

/// Lit colour at a hit, 0..255 per channel; the same from wherever it is seen unless the material has a gloss, whose
/// highlights go beyond 255.
ColorD LitColor(const SyntheticWorld& world, const WorldHit& hit, const Ray& ray, uint32_t seed);

}  // namespace acmp
