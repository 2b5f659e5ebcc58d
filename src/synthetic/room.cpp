#include "world.h"

namespace acmp {
namespace {

constexpr Vec3d kRoomCenter = {0.0, 0.05, 1.3};
constexpr Vec3d kRoomHalf = {2.1, 2.25, 1.3};

constexpr Material kWalls = {Pattern::kBlank, {205, 200, 188}, {}, 0, 0};
constexpr Material kDarkWood = {Pattern::kWood, {62, 38, 20}, {178, 122, 72}, 0};
constexpr Material kLightWood = {Pattern::kWood, {120, 84, 48}, {232, 198, 150}, 0};

// Boards along the foot of the walls, rails at the height of a chair's back and above, an inlay along the edge of the
// floor: blank surfaces have something to match at their outlines.
void AddWallTrim(std::vector<WorldObject>* objects) {
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

void AddTable(std::vector<WorldObject>* objects) {
  const Vec3d center = {0.05, 0.95, 0.0};
  objects->push_back(Box(center + Vec3d{0, 0, 0.73}, {0.72, 0.40, 0.02}, kLightWood, kYaw13));
  for (const double x : {-0.66, 0.66}) {
    for (const double y : {-0.34, 0.34}) {
      const Vec3d leg = center + Rotate(kYaw13, {x, y, 0});
      objects->push_back(Box({leg.x, leg.y, 0.355}, {0.03, 0.03, 0.355}, kLightWood, kYaw13));
    }
  }
}

void AddTableware(std::vector<WorldObject>* objects) {
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

void AddFurniture(std::vector<WorldObject>* objects) {
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

void AddPictures(std::vector<WorldObject>* objects) {
  const Material landscape = {Pattern::kNoise, {30, 80, 120}, {236, 214, 150}, 0};
  const Material portrait = {Pattern::kMosaic, {80, 40, 30}, {230, 190, 160}, 0.06};
  const Material poster = {Pattern::kMosaic, {240, 236, 220}, {60, 60, 70}, 0.08};
  objects->push_back(Box({0.22, 2.288, 1.50}, {0.36, 0.012, 0.25}, landscape));
  objects->push_back(Box({-1.05, 2.288, 1.42}, {0.20, 0.012, 0.28}, portrait));
  objects->push_back(Box({1.52, 2.288, 1.40}, {0.20, 0.012, 0.30}, portrait));
  objects->push_back(Box({-2.096, 1.15, 1.30}, {0.004, 0.34, 0.44}, poster));
  objects->push_back(Box({2.088, 0.55, 1.35}, {0.012, 0.28, 0.20}, landscape));
}

}  // namespace

SyntheticWorld MakeRoom() {
  SyntheticWorld world;
  std::vector<WorldObject>* objects = &world.objects;
  objects->push_back({{Shape::kRoom, kRoomCenter, kRoomHalf, {}}, kWalls});
  const auto add = [&](Label label, void (*add_some)(std::vector<WorldObject>*)) {
    const size_t before = objects->size();
    add_some(objects);
    for (size_t i = before; i < objects->size(); ++i) (*objects)[i].label = label;
  };
  add(kTrim, &AddWallTrim);
  add(kTable, &AddTable);
  add(kTableware, &AddTableware);
  add(kFurniture, &AddFurniture);
  add(kPicture, &AddPictures);
  world.wall_paint = {{152, 146, 138}, {228, 228, 224}, {186, 198, 196}, kWalls.color};
  world.lamp = {0.3, -0.6, 2.4};
  world.diameter_m = 6.7;
  // On the table. 0.043 is the tangent of half of 5 degrees; it grows by 3 % more than the angle up to 32.5 degrees.
  world.path = HandHeldPath{{0.0, 0.95, 0.85}, 2.55, 0.0430};
  return world;
}

}  // namespace acmp
