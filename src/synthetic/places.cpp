// The places, see SyntheticPlace.

#include "world.h"

namespace acmp {
namespace {

using Objects = std::vector<WorldObject>;

// Upright, from `bottom` to `top`.
WorldObject Rod(double x, double y, double bottom, double top, double radius, const Material& material) {
  return Cylinder({x, y, 0.5 * (bottom + top)}, radius, 0.5 * (top - bottom), material);
}

// The room.

constexpr Vec3d kRoomCenter = {0.0, 0.05, 1.3};
constexpr Vec3d kRoomHalf = {2.1, 2.25, 1.3};

constexpr Material kWalls = {Pattern::kBlank, {205, 200, 188}, {}, 0, 0};
constexpr Material kDarkWood = {Pattern::kWood, {62, 38, 20}, {178, 122, 72}, 0};
constexpr Material kLightWood = {Pattern::kWood, {120, 84, 48}, {232, 198, 150}, 0};

// Boards along the foot of the walls, rails at the height of a chair's back and above, an inlay along the edge of the
// floor: blank surfaces have something to match at their outlines.
void AddWallTrim(Objects* objects) {
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

void AddTable(Objects* objects) {
  const Vec3d center = {0.05, 0.95, 0.0};
  objects->push_back(Box(center + Vec3d{0, 0, 0.73}, {0.72, 0.40, 0.02}, kLightWood, kYaw13));
  for (const double x : {-0.66, 0.66}) {
    for (const double y : {-0.34, 0.34}) {
      const Vec3d leg = center + Rotate(kYaw13, {x, y, 0});
      objects->push_back(Box({leg.x, leg.y, 0.355}, {0.03, 0.03, 0.355}, kLightWood, kYaw13));
    }
  }
}

void AddTableware(Objects* objects) {
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

void AddFurniture(Objects* objects) {
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

void AddPictures(Objects* objects) {
  const Material landscape = {Pattern::kNoise, {30, 80, 120}, {236, 214, 150}, 0};
  const Material portrait = {Pattern::kMosaic, {80, 40, 30}, {230, 190, 160}, 0.06};
  const Material poster = {Pattern::kMosaic, {240, 236, 220}, {60, 60, 70}, 0.08};
  objects->push_back(Box({0.22, 2.288, 1.50}, {0.36, 0.012, 0.25}, landscape));
  objects->push_back(Box({-1.05, 2.288, 1.42}, {0.20, 0.012, 0.28}, portrait));
  objects->push_back(Box({1.52, 2.288, 1.40}, {0.20, 0.012, 0.30}, portrait));
  objects->push_back(Box({-2.096, 1.15, 1.30}, {0.004, 0.34, 0.44}, poster));
  objects->push_back(Box({2.088, 0.55, 1.35}, {0.012, 0.28, 0.20}, landscape));
}

// The office.

constexpr Vec3d kCenter = {0.0, 0.15, 1.3};
constexpr Vec3d kHalf = {2.3, 2.35, 1.3};
constexpr double kBackWall_y = kCenter.y + kHalf.y;

const Material kDarkMetal = Plain({44, 44, 48});
const Material kWhiteMetal = Plain({226, 226, 222});

void AddDesk(Objects* objects) {
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

void AddDeskware(Objects* objects) {
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
void AddChair(Objects* objects) {
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

void AddFurnishings(Objects* objects) {
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
void AddCables(Objects* objects) {
  const Material cable = Plain({50, 46, 44});
  objects->push_back(Rod(-0.72, 1.30, 1.72, 2 * kHalf.z, 0.004, cable));  // of a hanging lamp
  objects->push_back(Sphere({-0.72, 1.30, 1.62}, 0.11, Plain({232, 228, 214})));
  for (const double z : {1.70, 1.84}) objects->push_back(Box({0, 1.70, z}, {kHalf.x, 0.005, 0.005}, cable));
}

void AddWallDecoration(Objects* objects) {
  const Material tiles = {Pattern::kTiles, {196, 204, 206}, {120, 124, 128}, 0.08};
  const Material picture = {Pattern::kNoise, {40, 80, 110}, {230, 214, 160}, 0, 0.6};
  const Material board = {Pattern::kNoise, {150, 110, 70}, {206, 170, 124}, 0};
  const Material poster = {Pattern::kMosaic, {238, 234, 220}, {70, 70, 80}, 0.08};
  objects->push_back(Box({1.05, kBackWall_y - 0.008, 1.15}, {0.52, 0.008, 0.60}, tiles));
  objects->push_back(Box({-0.20, kBackWall_y - 0.01, 1.55}, {0.36, 0.01, 0.40}, picture));
  objects->push_back(Box({-0.72, kBackWall_y - 0.01, 1.05}, {0.24, 0.01, 0.30}, board));
  objects->push_back(Box({-kHalf.x + 0.005, 1.00, 1.30}, {0.005, 0.30, 0.42}, poster));
}

// The street.

// Fronts of the houses on both sides and at the end of the street.
constexpr double kLeft_x = -6.0, kRight_x = 6.5, kEnd_y = 52.0;

const Material kGlass = {Pattern::kBlank, {58, 66, 74}, {}, 0, 0.4};
const Material kFrame = Plain({220, 216, 206});
const Material kIron = Plain({52, 54, 56});
const Material kBark = {Pattern::kWood, {70, 56, 42}, {140, 118, 92}, 0};
const Material kLeaves = {Pattern::kNoise, {30, 52, 22}, {128, 150, 70}, 0};

void AddGround(Objects* objects) {
  const Material asphalt = {Pattern::kNoise, {98, 98, 100}, {132, 131, 128}, 0};
  const Material paving = {Pattern::kTiles, {150, 146, 140}, {112, 108, 104}, 0.4};
  const Material marking = Plain({214, 214, 208});
  objects->push_back(Box({0, 20, -0.5}, {40, 80, 0.5}, asphalt));
  for (const double side : {-1.0, 1.0}) objects->push_back(Box({side * 8.2, 20, 0.06}, {5.0, 80, 0.06}, paving));
  for (int i = -4; i < 12; ++i) objects->push_back(Box({0, 5.0 * i, 0.001}, {0.06, 1.5, 0.001}, marking));
}

// A house along the street: a front with storeys of windows that stand out by 6 cm, and a roof edge.
void AddHouse(double front_x, double first_y, double last_y, int storeys, const Material& wall, Objects* objects) {
  constexpr double kStorey = 3.1, kHalfDepth = 4.0, kBay = 2.6;
  const double side = front_x < 0 ? -1 : 1;
  const double height = kStorey * storeys + 0.6;
  const double middle_y = 0.5 * (first_y + last_y), half_y = 0.5 * (last_y - first_y);
  objects->push_back(
      Box({front_x + side * kHalfDepth, middle_y, 0.5 * height}, {kHalfDepth, half_y, 0.5 * height}, wall));
  objects->push_back(Box({front_x, middle_y, height}, {0.25, half_y, 0.12}, kFrame));  // cornice
  const int bays = static_cast<int>((last_y - first_y) / kBay);
  for (int storey = 0; storey < storeys; ++storey) {
    for (int bay = 0; bay < bays; ++bay) {
      const Vec3d center = {front_x, first_y + kBay * (bay + 0.5), kStorey * storey + 1.75};
      objects->push_back(Box(center, {0.06, 0.55, 0.80}, kFrame));
      objects->push_back(Box(center, {0.07, 0.47, 0.72}, kGlass));
    }
  }
}

void AddHouses(Objects* objects) {
  const Material plaster = Plain({206, 196, 172});
  const Material grey_plaster = Plain({176, 180, 184});
  const Material roughcast = {Pattern::kNoise, {168, 150, 128}, {190, 172, 150}, 0};  // hardly above the noise
  const Material brick = {Pattern::kTiles, {150, 86, 66}, {184, 172, 158}, 0.15};
  const Material stone = {Pattern::kMosaic, {150, 140, 122}, {204, 196, 178}, 0.5};
  AddHouse(kLeft_x, -12, 11, 2, plaster, objects);
  AddHouse(kLeft_x, 11, 24, 3, stone, objects);
  AddHouse(kLeft_x, 31, 50, 2, roughcast, objects);  // a gap before it
  AddHouse(kRight_x, -12, 7, 3, roughcast, objects);
  AddHouse(kRight_x, 12, 27, 2, brick, objects);
  AddHouse(kRight_x, 27, 46, 3, grey_plaster, objects);
  objects->push_back(Box({-4, kEnd_y + 3, 4}, {7, 3, 4}, stone));  // at the end
}

void AddTree(double x, double y, Objects* objects) {
  objects->push_back(Rod(x, y, 0, 2.6, 0.14, kBark));
  objects->push_back(Sphere({x, y, 3.6}, 1.2, kLeaves));
  objects->push_back(Sphere({x + 0.5, y - 0.6, 4.4}, 0.9, kLeaves));
  objects->push_back(Sphere({x - 0.6, y + 0.4, 4.3}, 0.8, kLeaves));
}

// Two boxes and a plate; what stands on the road is not a car's shape but has its size and its blank paint.
void AddCar(double x, double y, const ColorD& paint, Objects* objects) {
  Material body = Plain(paint);
  body.gloss = 0.5;
  objects->push_back(Box({x, y, 0.58}, {0.88, 2.1, 0.34}, body));
  objects->push_back(Box({x, y + 0.2, 1.17}, {0.76, 1.1, 0.25}, kGlass));
  objects->push_back(Box({x, y + 0.2, 1.44}, {0.76, 1.05, 0.02}, body));
  objects->push_back(
      Box({x, y - 2.1, 0.50}, {0.26, 0.01, 0.06}, {Pattern::kMosaic, {240, 240, 240}, {30, 30, 30}, 0.05}));
  for (const double end : {-1.3, 1.3}) objects->push_back(Box({x, y + end, 0.30}, {0.86, 0.30, 0.30}, kIron));
}

void AddStreetFurniture(Objects* objects) {
  for (int i = 0; i < 5; ++i) objects->push_back(Rod(-3.6, 4.0 + 11.0 * i, 0, 5.5, 0.06, kIron));
  for (int i = 0; i < 6; ++i) objects->push_back(Rod(3.5, 9.0 + 1.8 * i, 0, 0.9, 0.05, kIron));  // bollards
  objects->push_back(
      Box({3.6, 6.0, 2.2}, {0.30, 0.01, 0.30}, {Pattern::kMosaic, {230, 60, 50}, {240, 240, 240}, 0.15}));
  objects->push_back(Rod(3.6, 6.03, 0, 2.5, 0.03, kIron));             // traffic sign
  objects->push_back(Box({8.5, 9.5, 0.8}, {2.0, 0.4, 0.8}, kLeaves));  // hedge in the gap
  for (const double z : {6.2, 6.5}) objects->push_back(Box({0, 16.0, z}, {6.5, 0.012, 0.012}, kIron));  // wires
}

}  // namespace

SyntheticWorld MakeRoom() {
  SyntheticWorld world;
  Objects* objects = &world.objects;
  objects->push_back({{Shape::kRoom, kRoomCenter, kRoomHalf, {}}, kWalls});
  const auto add = [&](Label label, void (*add_some)(Objects*)) {
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

SyntheticWorld MakeOffice() {
  SyntheticWorld world;
  Objects* objects = &world.objects;
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

SyntheticWorld MakeStreet() {
  SyntheticWorld world;
  Objects* objects = &world.objects;
  objects->push_back({{Shape::kRoom, {0, 20, 30}, {60, 80, 60}, {}}, Plain({})});
  AddGround(objects);
  AddHouses(objects);
  for (const double y : {14.0, 22.0, 34.0}) AddTree(4.6, y, objects);
  AddTree(-4.7, 28.0, objects);
  AddCar(2.2, 13.0, {150, 30, 34}, objects);
  AddCar(2.2, 19.5, {226, 228, 230}, objects);
  AddCar(-2.2, 24.0, {40, 60, 96}, objects);
  AddStreetFurniture(objects);
  world.sky = true;
  world.lamp = {-30, -20, 60};
  world.diameter_m = 234;
  world.path = StraightPath{{0.6, -6.0, 1.6}, 0.45, 40};
  return world;
}

}  // namespace acmp
