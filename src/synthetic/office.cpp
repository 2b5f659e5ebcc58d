#include "world.h"

namespace acmp {
namespace {

constexpr Vec3d kCenter = {0.0, 0.15, 1.3};
constexpr Vec3d kHalf = {2.3, 2.35, 1.3};
constexpr double kBackWall_y = kCenter.y + kHalf.y;

const Material kDarkMetal = Plain({44, 44, 48});
const Material kWhiteMetal = Plain({226, 226, 222});

// Upright, from `bottom` to `top`.
WorldObject Rod(double x, double y, double bottom, double top, double radius, const Material& material) {
  return Cylinder({x, y, 0.5 * (bottom + top)}, radius, 0.5 * (top - bottom), material);
}

void AddDesk(std::vector<WorldObject>* objects) {
  const Vec3d center = {0.10, 1.05, 0.0};
  const Material wood = {Pattern::kWood, {166, 132, 92}, {202, 168, 126}, 0};  // faint grain
  objects->push_back(Box(center + Vec3d{0, 0, 0.735}, {0.72, 0.36, 0.015}, wood, kYaw13));
  for (const double x : {-0.68, 0.68}) {
    for (const double y : {-0.32, 0.32}) {
      const Vec3d leg = center + Rotate(kYaw13, {x, y, 0});
      objects->push_back(Rod(leg.x, leg.y, 0, 0.72, 0.0125, kWhiteMetal));
    }
  }
}

void AddDeskware(std::vector<WorldObject>* objects) {
  constexpr double kTop = 0.75;
  const Material screen = Plain({30, 30, 34});
  const Material package = {Pattern::kMosaic, {60, 90, 150}, {226, 220, 200}, 0.05};
  const Material book = {Pattern::kNoise, {120, 60, 50}, {206, 190, 150}, 0};
  const Material ball = {Pattern::kNoise, {190, 120, 40}, {240, 226, 190}, 0};
  objects->push_back(Box({0.24, 1.18, kTop + 0.26}, {0.28, 0.018, 0.17}, screen, kYaw13));
  objects->push_back(Rod(0.24, 1.21, kTop, kTop + 0.20, 0.02, kDarkMetal));
  objects->push_back(Box({-0.34, 1.00, kTop + 0.13}, {0.09, 0.04, 0.13}, package, kYawMinus28));
  objects->push_back(Box({0.44, 0.86, kTop + 0.02}, {0.14, 0.10, 0.02}, book, kYaw37));
  objects->push_back(Sphere({-0.10, 0.84, kTop + 0.09}, 0.09, ball));
  objects->push_back(Rod(0.16, 0.86, kTop, kTop + 0.10, 0.04, kWhiteMetal));  // mug
}

// A chair with its back towards the camera: what is behind is seen between rods of 12 mm.
void AddChair(std::vector<WorldObject>* objects) {
  constexpr double kX = -0.32, kY = 0.32, kSeat = 0.45, kHalfSeat = 0.20;
  const Material fabric = {Pattern::kNoise, {60, 70, 90}, {150, 160, 170}, 0};
  objects->push_back(Box({kX, kY, kSeat}, {kHalfSeat, kHalfSeat, 0.015}, fabric));
  for (const double x : {-0.18, 0.18}) {
    for (const double y : {-0.18, 0.18}) objects->push_back(Rod(kX + x, kY + y, 0, kSeat, 0.009, kDarkMetal));
  }
  constexpr int kRods = 5;
  for (int i = 0; i < kRods; ++i) {
    objects->push_back(Rod(kX - 0.18 + 0.09 * i, kY - 0.18, kSeat, 0.95, 0.006, kDarkMetal));
  }
  objects->push_back(Box({kX, kY - 0.18, 0.96}, {kHalfSeat, 0.008, 0.012}, kDarkMetal));
}

void AddFurnishings(std::vector<WorldObject>* objects) {
  const Material carpet = {Pattern::kNoise, {138, 120, 112}, {164, 146, 134}, 0};  // hardly above the noise
  const Material books = {Pattern::kBooks, {92, 60, 34}, {236, 226, 206}, 0.05};
  const Material shade = Plain({244, 232, 200});
  objects->push_back(Box({0.0, 1.0, 0.003}, {1.60, 1.10, 0.003}, carpet));
  objects->push_back(Box({0.0, kBackWall_y - 0.007, 0.05}, {kHalf.x, 0.007, 0.05}, Plain({96, 84, 72})));  // skirting
  const Material veneer = {Pattern::kWood, {104, 78, 56}, {136, 106, 80}, 0};
  objects->push_back(Box({-1.60, 2.14, 0.95}, {0.55, 0.34, 0.95}, veneer));  // cupboard
  for (const double x : {-1.64, -1.56}) objects->push_back(Rod(x, 1.785, 0.9, 1.1, 0.006, kWhiteMetal));
  objects->push_back(Box({2.02, 1.60, 0.80}, {0.26, 0.50, 0.80}, books));
  objects->push_back(Rod(1.20, 1.90, 0, 0.02, 0.14, kDarkMetal));  // standard lamp
  objects->push_back(Rod(1.20, 1.90, 0.02, 1.50, 0.0125, kDarkMetal));
  objects->push_back(Sphere({1.20, 1.90, 1.60}, 0.15, shade));
}

// Cables of 8 and 10 mm: 1.3 to 2.1 px wide at 2.6 to 3.3 m and 640 px, 0.5 to 0.8 px at 240 px.
void AddCables(std::vector<WorldObject>* objects) {
  const Material cable = Plain({50, 46, 44});
  objects->push_back(Rod(-0.72, 1.30, 1.72, 2 * kHalf.z, 0.004, cable));  // of a hanging lamp
  objects->push_back(Sphere({-0.72, 1.30, 1.62}, 0.11, Plain({232, 228, 214})));
  for (const double z : {1.70, 1.84}) objects->push_back(Box({0, 1.70, z}, {kHalf.x, 0.005, 0.005}, cable));
}

void AddWallDecoration(std::vector<WorldObject>* objects) {
  const Material tiles = {Pattern::kTiles, {196, 204, 206}, {120, 124, 128}, 0.08};
  const Material picture = {Pattern::kNoise, {40, 80, 110}, {230, 214, 160}, 0, 0.6};
  const Material board = {Pattern::kNoise, {150, 110, 70}, {206, 170, 124}, 0};
  const Material poster = {Pattern::kMosaic, {238, 234, 220}, {70, 70, 80}, 0.08};
  objects->push_back(Box({1.05, kBackWall_y - 0.008, 1.15}, {0.52, 0.008, 0.60}, tiles));
  objects->push_back(Box({-0.20, kBackWall_y - 0.01, 1.55}, {0.36, 0.01, 0.40}, picture));
  objects->push_back(Box({-0.72, kBackWall_y - 0.01, 1.05}, {0.24, 0.01, 0.30}, board));
  objects->push_back(Box({-kHalf.x + 0.005, 1.00, 1.30}, {0.005, 0.30, 0.42}, poster));
}

}  // namespace

SyntheticWorld MakeOffice() {
  SyntheticWorld world;
  std::vector<WorldObject>* objects = &world.objects;
  objects->push_back({{Shape::kRoom, kCenter, kHalf, {}}, Plain({})});
  AddDesk(objects);
  AddDeskware(objects);
  AddChair(objects);
  AddFurnishings(objects);
  AddCables(objects);
  AddWallDecoration(objects);
  world.wall_paint = {{158, 154, 148}, {226, 226, 222}, {196, 202, 200}, {210, 206, 198}};
  world.lamp = {0.3, -0.6, 2.4};
  world.diameter_m = 7.1;
  world.path = HandHeldPath{{0.0, 1.0, 0.85}, 2.4, 0.0349};  // the tangent of half of 4 degrees
  return world;
}

}  // namespace acmp
