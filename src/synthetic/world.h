#pragma once

#include <cstdint>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

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

/// Linear colour, 0..255 per channel.
struct ColorD {
  double r, g, b;
};

enum class Pattern {
  kBlank,   ///< one colour
  kNoise,   ///< two colours mixed by noise of six octaves, cells of 24 cm down to 7.5 mm
  kWood,    ///< the same, drawn out along the solid's x axis
  kMosaic,  ///< square tiles of `cell_m` with colours of their own
  kTiles,   ///< equal tiles of `cell_m` with a joint of a tenth between them
  kBooks,   ///< rows of upright spines, `cell_m` wide on average, each with a colour of its own
};

struct Material {
  Pattern pattern = Pattern::kBlank;
  ColorD color = {128, 128, 128};
  ColorD other = {128, 128, 128};  ///< not read by kBlank
  double cell_m = 0.05;            ///< kMosaic, kTiles and kBooks
  double gloss = 0;                ///< 0..1: brightness of the lamp's highlight; not part of TextureColor()
};

inline Material Plain(const ColorD& color) { return {Pattern::kBlank, color, {}, 0}; }

/// Colour without light at a point of a solid, given in the solid's own frame. `key` tells equal materials apart.
ColorD TextureColor(const Material& material, uint32_t key, const Vec3d& local, const Vec3d& local_normal);

/// Bell-shaped random number with mean 0: four uniform draws, scaled. Never beyond 3.5 sigma; no libm.
double BellNoise(RandomStream* random, double sigma);

/// Smooth value noise in 0..1 of one cell per unit.
double ValueNoise(uint32_t key, const Vec3d& position);

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

/// Exposure of image `index`, as a factor.
double ExposureOf(const ImagingModel& model, uint32_t seed, int index);

/// The camera at `count` evenly spaced moments while the shutter is open; `pose` lies in their middle. The camera only
/// turns: at 0.2 m/s it moves 3 mm in 1/60 s, at 2.4 m a third of what a shake of 0.25 degrees moves the image.
std::vector<CameraPose> PosesDuringExposure(const ImagingModel& model, const CameraPose& pose, uint32_t seed, int index,
                                            int count);

/// Largest angle in radians between a pose during the exposure and the one in the middle.
double LargestTurn(const ImagingModel& model);

/// Pixels around the image that its blur reads.
int PsfBorder(const ImagingModel& model);

/// Blurs an image that has PsfBorder() more pixels on each side than the result. Repeated symmetric kernels of three
/// taps with the model's variance in all: close to a Gaussian, and exact without libm.
Image<ColorD> BlurByPsf(const ImagingModel& model, Image<ColorD> light);

/// Share of the light that reaches a pixel.
double VignettingAt(const ImagingModel& model, const PinholeCamera& camera, int col, int row);

/// Grey levels of one pixel whose noiseless signal is `signal`.
Rgb Digitize(const ImagingModel& model, const ColorD& signal, RandomStream* random);

struct WorldObject {
  Solid solid;
  Material material;
  Label label = kThing;  ///< of kRoom it is that of the surface: LabelOf
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
/// Indices of the objects that a ray within `margin` metres of this one, up to the far wall, can meet; the room itself
/// is always one. Tracing a pixel's many rays against these alone gives the same hits several times faster.
std::vector<size_t> ObjectsNear(const SyntheticWorld& world, const Ray& ray, double margin);
/// @param objects to look at; null: all of them
WorldHit Trace(const SyntheticWorld& world, const Ray& ray, const std::vector<size_t>* objects = nullptr);

Label LabelOf(const SyntheticWorld& world, const WorldHit& hit);

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
  LabelImage labels = LabelImage(camera.width, camera.height);
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
