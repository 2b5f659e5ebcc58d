#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "camera.h"
#include "geometry.h"
#include "texture.h"

namespace acmp {

struct WorldObject {
  Solid solid;
  Material material;
};

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

/// The places, see SyntheticPlace.
SyntheticWorld MakeRoom();
SyntheticWorld MakeOffice();
SyntheticWorld MakeStreet();

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

/// The place as it is when image `index` is taken: with something textured that goes along with the camera at 3/10 of
/// its speed. To whoever takes it for a part of the place, it stands 1.4 times as far away as it is: most views agree.
/// It is the last of the objects.
SyntheticWorld WithMovingObject(const SyntheticWorld& world, int index, const SyntheticSceneOptions& options);

/// Ignores the pixels that show the last object of `world`, and those around that lens, shutter and the pixels' area
/// may have mixed with it.
Mask MaskOfLastObject(const SyntheticWorld& world, const PinholeCamera& camera, const CameraPose& pose,
                      const ImagingModel& imaging);

/// An image before it becomes a SyntheticView, whose maps it has.
struct Rendering {
  PinholeCamera camera;
  CameraPose pose;
  double exposure = 1;  ///< factor on the light
  ColorImage color = ColorImage(camera.width, camera.height);
  DepthMap depth = DepthMap(camera.width, camera.height);
  NormalMap normal = NormalMap(camera.width, camera.height);
  Image<unsigned char> low_texture = Image<unsigned char>(camera.width, camera.height);
  Mask mask = {};
  DepthMap shown_depth = {};
};

/// Per view the sparse map points it observes, as a SLAM frontend would: corners on textured surfaces found view by
/// view where no earlier point is near, kept when at least three views (two when there are only two) see them, with a
/// position error of a few millimetres. A point has the same coordinates in all views that observe it; none is
/// occluded.
std::vector<std::vector<Eigen::Vector3d>> MakeLandmarks(const SyntheticWorld& world,
                                                        const std::vector<Rendering>& views, uint32_t seed);

}  // namespace acmp
