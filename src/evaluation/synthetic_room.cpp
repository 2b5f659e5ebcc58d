#include "synthetic_room.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace acmp {
namespace {

constexpr Vec3d kRoomCenter = {0.0, 0.05, 1.3};
constexpr Vec3d kRoomHalf = {2.1, 2.25, 1.3};
constexpr Vec3d kLamp = {0.3, -0.6, 2.4};
constexpr Vec3d kTarget = {0.0, 0.95, 0.85};  // what the camera looks at, on the table
constexpr double kOrbit_m = 2.55;

// Angles with rational cosine and sine (Pythagorean triples), exact without libm.
constexpr Yaw kYaw13 = {40.0 / 41.0, 9.0 / 41.0};
constexpr Yaw kYaw23 = {12.0 / 13.0, 5.0 / 13.0};
constexpr Yaw kYawMinus28 = {15.0 / 17.0, -8.0 / 17.0};
constexpr Yaw kYaw37 = {4.0 / 5.0, 3.0 / 5.0};

constexpr Material kWalls = {Pattern::kBlank, {205, 200, 188}, {}, 0};
constexpr Material kDarkWood = {Pattern::kWood, {62, 38, 20}, {178, 122, 72}, 0};
constexpr Material kLightWood = {Pattern::kWood, {120, 84, 48}, {232, 198, 150}, 0};

RoomObject Box(const Vec3d& center, const Vec3d& half, const Material& material, const Yaw& yaw = {}) {
  return {{Shape::kBox, center, half, yaw}, material};
}

RoomObject Cylinder(const Vec3d& center, double radius, double half_height, const Material& material) {
  return {{Shape::kCylinder, center, {radius, radius, half_height}, {}}, material};
}

RoomObject Sphere(const Vec3d& center, double radius, const Material& material) {
  return {{Shape::kSphere, center, {radius, radius, radius}, {}}, material};
}

// Boards along the foot of the walls, rails at the height of a chair's back and above, an inlay along the edge of the
// floor: blank surfaces have something to match at their outlines.
void AddWallTrim(std::vector<RoomObject>* objects) {
  const Material rail = {Pattern::kMosaic, {120, 60, 44}, {226, 206, 170}, 0.04};
  struct Strip {
    double center_z, half_z, half_thickness;
    Material material;
  };
  for (const Strip& strip :
       {Strip{0.05, 0.05, 0.008, kDarkWood}, Strip{0.92, 0.04, 0.006, rail}, Strip{1.94, 0.045, 0.006, rail}}) {
    const double x = kRoomHalf.x - strip.half_thickness;
    const double y = kRoomHalf.y - strip.half_thickness;
    for (const double side : {-1.0, 1.0}) {
      objects->push_back(Box({kRoomCenter.x + side * x, kRoomCenter.y, strip.center_z},
                             {strip.half_thickness, kRoomHalf.y, strip.half_z}, strip.material));
      objects->push_back(Box({kRoomCenter.x, kRoomCenter.y + side * y, strip.center_z},
                             {kRoomHalf.x, strip.half_thickness, strip.half_z}, strip.material));
    }
  }
  constexpr double kInlay_x = 1.62, kInlay_back_y = 1.72, kHalfWidth = 0.03, kHalfHeight = 0.001;
  const double front_y = kRoomCenter.y - kRoomHalf.y;
  for (const double side : {-1.0, 1.0}) {
    objects->push_back(Box({side * kInlay_x, 0.5 * (front_y + kInlay_back_y), kHalfHeight},
                           {kHalfWidth, 0.5 * (kInlay_back_y - front_y), kHalfHeight}, rail));
  }
  objects->push_back(Box({0.0, kInlay_back_y, kHalfHeight}, {kInlay_x, kHalfWidth, kHalfHeight}, rail));
}

void AddTable(std::vector<RoomObject>* objects) {
  const Vec3d center = {0.05, 0.95, 0.0};
  objects->push_back(Box(center + Vec3d{0, 0, 0.73}, {0.72, 0.40, 0.02}, kLightWood, kYaw13));
  for (const double x : {-0.66, 0.66}) {
    for (const double y : {-0.34, 0.34}) {
      const Vec3d leg = center + Rotate(kYaw13, {x, y, 0});
      objects->push_back(Box({leg.x, leg.y, 0.355}, {0.03, 0.03, 0.355}, kLightWood, kYaw13));
    }
  }
}

void AddTableware(std::vector<RoomObject>* objects) {
  constexpr double kTop = 0.75;
  const Material cereal = {Pattern::kMosaic, {214, 60, 40}, {250, 214, 90}, 0.05};
  const Material carton = {Pattern::kNoise, {40, 60, 120}, {220, 226, 236}, 0};
  const Material book = {Pattern::kNoise, {30, 90, 70}, {214, 200, 120}, 0};
  const Material ball = {Pattern::kNoise, {200, 40, 60}, {250, 236, 214}, 0};
  const Material vase = {Pattern::kNoise, {20, 50, 90}, {190, 214, 230}, 0};
  objects->push_back(Box({-0.30, 1.02, kTop + 0.15}, {0.10, 0.04, 0.15}, cereal, kYawMinus28));
  objects->push_back(Box({0.02, 1.20, kTop + 0.10}, {0.11, 0.07, 0.10}, carton, kYaw37));
  objects->push_back(Box({0.42, 0.90, kTop + 0.025}, {0.15, 0.11, 0.025}, book, kYaw23));
  objects->push_back(Box({0.43, 0.91, kTop + 0.07}, {0.12, 0.09, 0.02}, cereal, kYawMinus28));
  objects->push_back(Sphere({-0.04, 0.78, kTop + 0.11}, 0.11, ball));
  objects->push_back(Cylinder({0.50, 1.24, kTop + 0.11}, 0.055, 0.11, vase));
}

void AddFurniture(std::vector<RoomObject>* objects) {
  const Material books = {Pattern::kBooks, {92, 60, 34}, {236, 226, 206}, 0.05};
  const Material fabric = {Pattern::kNoise, {50, 70, 60}, {206, 210, 180}, 0};
  const Material shade = {Pattern::kNoise, {196, 150, 70}, {250, 240, 206}, 0};
  const Material metal = {Pattern::kNoise, {36, 36, 40}, {150, 150, 158}, 0};
  const Material rug = {Pattern::kMosaic, {120, 40, 44}, {220, 180, 140}, 0.10};
  objects->push_back(Box({0.05, 0.95, 0.004}, {1.05, 0.70, 0.004}, rug, kYaw13));
  objects->push_back(Box({-1.25, 2.05, 0.36}, {0.52, 0.22, 0.36}, kDarkWood));       // sideboard
  objects->push_back(Box({-1.38, 2.08, 0.72 + 0.12}, {0.28, 0.11, 0.12}, books));    // on it
  objects->push_back(Box({1.88, 1.55, 0.75}, {0.20, 0.42, 0.75}, books));            // bookshelf
  objects->push_back(Box({-0.98, 0.42, 0.22}, {0.19, 0.19, 0.22}, fabric, kYaw23));  // stool
  objects->push_back(Cylinder({0.95, 2.00, 0.015}, 0.14, 0.015, metal));             // standard lamp
  objects->push_back(Cylinder({0.95, 2.00, 0.72}, 0.014, 0.70, metal));
  objects->push_back(Sphere({0.95, 2.00, 1.52}, 0.16, shade));
}

void AddPictures(std::vector<RoomObject>* objects) {
  const Material landscape = {Pattern::kNoise, {30, 80, 120}, {236, 214, 150}, 0};
  const Material portrait = {Pattern::kMosaic, {80, 40, 30}, {230, 190, 160}, 0.06};
  const Material poster = {Pattern::kMosaic, {240, 236, 220}, {60, 60, 70}, 0.08};
  objects->push_back(Box({0.22, 2.288, 1.50}, {0.36, 0.012, 0.25}, landscape));
  objects->push_back(Box({-1.05, 2.288, 1.42}, {0.20, 0.012, 0.28}, portrait));
  objects->push_back(Box({1.52, 2.288, 1.40}, {0.20, 0.012, 0.30}, portrait));
  objects->push_back(Box({-2.096, 1.15, 1.30}, {0.004, 0.34, 0.44}, poster));
  objects->push_back(Box({2.088, 0.55, 1.35}, {0.012, 0.28, 0.20}, landscape));
}

std::vector<RoomObject> BuildRoom() {
  std::vector<RoomObject> objects;
  objects.push_back({{Shape::kRoom, kRoomCenter, kRoomHalf, {}}, kWalls});
  AddWallTrim(&objects);
  AddTable(&objects);
  AddTableware(&objects);
  AddFurniture(&objects);
  AddPictures(&objects);
  return objects;
}

// Floor, ceiling and the two pairs of walls are painted apart, so that their edges can be seen.
ColorD RoomPaint(const Vec3d& normal) {
  if (normal.z > 0.5) return {152, 146, 138};
  if (normal.z < -0.5) return {228, 228, 224};
  if (std::abs(normal.x) > 0.5) return {186, 198, 196};
  return kWalls.color;
}

// Tangent-half-angle form: smooth, exact to rounding, no libm.
Yaw YawOf(double half_angle_tangent) {
  const double q = half_angle_tangent * half_angle_tangent;
  return {(1.0 - q) / (1.0 + q), 2.0 * half_angle_tangent / (1.0 + q)};
}

// Value in -1..1 that drifts with a period of a few keyframes.
double Sway(uint32_t seed, uint32_t axis, int index) {
  return 2.0 * ValueNoise(seed * 977u + axis, {0.37 * index + 0.5, 0.5, 0.5}) - 1.0;
}

}  // namespace

const std::vector<RoomObject>& RoomObjects() {
  static const std::vector<RoomObject> kObjects = BuildRoom();
  return kObjects;
}

RoomHit TraceRoom(const Ray& ray) {
  static const std::vector<size_t> kAll = [] {
    std::vector<size_t> all(RoomObjects().size());
    std::iota(all.begin(), all.end(), size_t{0});
    return all;
  }();
  return TraceRoom(ray, kAll);
}

std::vector<size_t> ObjectsNear(const Ray& ray, double margin) {
  const std::vector<RoomObject>& objects = RoomObjects();
  std::vector<size_t> near;
  for (size_t i = 0; i < objects.size(); ++i) {
    // Grown by the margin, the solid holds every point that lies within the margin of a point of its own.
    Solid grown = objects[i].solid;
    grown.size = grown.size + Vec3d{margin, margin, margin};
    if (Intersect(grown, ray)) near.push_back(i);
  }
  return near;
}

RoomHit TraceRoom(const Ray& ray, const std::vector<size_t>& candidates) {
  const std::vector<RoomObject>& objects = RoomObjects();
  RoomHit first;
  first.where.t = std::numeric_limits<double>::infinity();
  for (const size_t i : candidates) {
    const auto hit = Intersect(objects[i].solid, ray);
    if (!hit || hit->t >= first.where.t) continue;
    first.where = *hit;
    first.object = i;
  }
  first.low_texture = objects[first.object].material.pattern == Pattern::kBlank;
  return first;
}

ColorD RoomColor(const RoomHit& hit, const Ray& ray, uint32_t seed) {
  const RoomObject& object = RoomObjects()[hit.object];
  const Vec3d& normal = hit.where.normal;
  const ColorD paint = object.solid.shape == Shape::kRoom
                           ? RoomPaint(normal)
                           : TextureColor(object.material, seed * 7919u + static_cast<uint32_t>(hit.object) * 101u,
                                          hit.where.local, hit.where.local_normal);
  // Mostly diffuse light: a faint gradient on walls and floor, edges of boxes still show.
  const Vec3d point = ray.origin + hit.where.t * ray.direction;
  const double facing = std::max(0.0, Dot(normal, Normalized(kLamp - point)));
  const double light = object.solid.shape == Shape::kRoom ? 0.92 + 0.08 * facing : 0.72 + 0.28 * facing;
  return {light * paint.r, light * paint.g, light * paint.b};
}

CameraPose HandHeldPose(int index, int count, uint32_t seed) {
  constexpr int kPerArc = 14;
  constexpr int kArcs = 3;  // heights: there and back again, then repeated with another sway
  const int per_arc = std::min(count, kPerArc);
  const int arc = index / per_arc;
  const int step = arc % 2 == 0 ? index % per_arc : per_arc - 1 - index % per_arc;
  const int cycle = arc % (2 * kArcs - 2);
  const int level = cycle < kArcs ? cycle : 2 * kArcs - 2 - cycle;

  // tan of half of 5 degrees: the tangent grows by 3 % more than the angle up to 32.5 degrees.
  constexpr double kTanPerStep = 0.0430;
  const Yaw angle = YawOf(kTanPerStep * (step - 0.5 * (per_arc - 1)));
  const double radius = kOrbit_m + 0.05 * Sway(seed, 1, index);
  const double height = 1.42 + 0.22 * level + 0.06 * Sway(seed, 2, index);
  CameraPose pose;
  pose.center = {kTarget.x + radius * angle.sin + 0.02 * Sway(seed, 3, index), kTarget.y - radius * angle.cos, height};
  const Vec3d target = kTarget + Vec3d{0.06 * Sway(seed, 4, index), 0.0, 0.05 * Sway(seed, 5, index)};
  pose.forward = Normalized(target - pose.center);
  const Vec3d level_right = Normalized(Cross(pose.forward, {0, 0, 1}));
  const Vec3d level_down = Cross(pose.forward, level_right);
  const Yaw roll = YawOf(0.02 * Sway(seed, 6, index));  // up to 2.3 degrees
  pose.right = roll.cos * level_right + roll.sin * level_down;
  pose.down = roll.cos * level_down - roll.sin * level_right;
  return pose;
}

PinholeCamera RoomCamera(int width, int height) {
  constexpr double kFocalPerWidth = 0.8660254037844386;  // 0.5 / tan(30 degrees)
  return {
      width, height, kFocalPerWidth * width, 1.004 * kFocalPerWidth * width, 0.508 * width - 0.5, 0.494 * height - 0.5};
}

Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row) {
  const double x = (col - camera.cx) / camera.fx;
  const double y = (row - camera.cy) / camera.fy;
  return {pose.center, x * pose.right + y * pose.down + pose.forward};
}

}  // namespace acmp
