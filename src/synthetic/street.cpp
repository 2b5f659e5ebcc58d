#include "world.h"

namespace acmp {
namespace {

// Fronts of the houses on both sides and at the end of the street.
constexpr double kLeft_x = -6.0, kRight_x = 6.5, kEnd_y = 52.0;

const Material kGlass = {Pattern::kBlank, {58, 66, 74}, {}, 0, 0.4};
const Material kFrame = Plain({220, 216, 206});
const Material kIron = Plain({52, 54, 56});
const Material kBark = {Pattern::kWood, {70, 56, 42}, {140, 118, 92}, 0};
const Material kLeaves = {Pattern::kNoise, {30, 52, 22}, {128, 150, 70}, 0};

// Upright, from the ground on.
WorldObject Post(double x, double y, double top, double radius, const Material& material) {
  return Cylinder({x, y, 0.5 * top}, radius, 0.5 * top, material);
}

void AddGround(std::vector<WorldObject>* objects) {
  const Material asphalt = {Pattern::kNoise, {98, 98, 100}, {132, 131, 128}, 0};
  const Material paving = {Pattern::kTiles, {150, 146, 140}, {112, 108, 104}, 0.4};
  const Material marking = Plain({214, 214, 208});
  objects->push_back(Box({0, 20, -0.5}, {40, 80, 0.5}, asphalt));
  for (const double side : {-1.0, 1.0}) objects->push_back(Box({side * 8.2, 20, 0.06}, {5.0, 80, 0.06}, paving));
  for (int i = -4; i < 12; ++i) objects->push_back(Box({0, 5.0 * i, 0.001}, {0.06, 1.5, 0.001}, marking));
}

// A house along the street: a front with storeys of windows that stand out by 6 cm, and a roof edge.
void AddHouse(double front_x, double first_y, double last_y, int storeys, const Material& wall,
              std::vector<WorldObject>* objects) {
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

void AddHouses(std::vector<WorldObject>* objects) {
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

void AddTree(double x, double y, std::vector<WorldObject>* objects) {
  objects->push_back(Post(x, y, 2.6, 0.14, kBark));
  objects->push_back(Sphere({x, y, 3.6}, 1.2, kLeaves));
  objects->push_back(Sphere({x + 0.5, y - 0.6, 4.4}, 0.9, kLeaves));
  objects->push_back(Sphere({x - 0.6, y + 0.4, 4.3}, 0.8, kLeaves));
}

// Two boxes and a plate; what stands on the road is not a car's shape but has its size and its blank paint.
void AddCar(double x, double y, const ColorD& paint, std::vector<WorldObject>* objects) {
  Material body = Plain(paint);
  body.gloss = 0.5;
  objects->push_back(Box({x, y, 0.58}, {0.88, 2.1, 0.34}, body));
  objects->push_back(Box({x, y + 0.2, 1.17}, {0.76, 1.1, 0.25}, kGlass));
  objects->push_back(Box({x, y + 0.2, 1.44}, {0.76, 1.05, 0.02}, body));
  objects->push_back(
      Box({x, y - 2.1, 0.50}, {0.26, 0.01, 0.06}, {Pattern::kMosaic, {240, 240, 240}, {30, 30, 30}, 0.05}));
  for (const double end : {-1.3, 1.3}) objects->push_back(Box({x, y + end, 0.30}, {0.86, 0.30, 0.30}, kIron));
}

void AddStreetFurniture(std::vector<WorldObject>* objects) {
  for (int i = 0; i < 5; ++i) objects->push_back(Post(-3.6, 4.0 + 11.0 * i, 5.5, 0.06, kIron));
  for (int i = 0; i < 6; ++i) objects->push_back(Post(3.5, 9.0 + 1.8 * i, 0.9, 0.05, kIron));  // bollards
  objects->push_back(
      Box({3.6, 6.0, 2.2}, {0.30, 0.01, 0.30}, {Pattern::kMosaic, {230, 60, 50}, {240, 240, 240}, 0.15}));
  objects->push_back(Post(3.6, 6.03, 2.5, 0.03, kIron));               // traffic sign
  objects->push_back(Box({8.5, 9.5, 0.8}, {2.0, 0.4, 0.8}, kLeaves));  // hedge in the gap
  for (const double z : {6.2, 6.5}) objects->push_back(Box({0, 16.0, z}, {6.5, 0.012, 0.012}, kIron));  // wires
}

}  // namespace

SyntheticWorld MakeStreet() {
  SyntheticWorld world;
  std::vector<WorldObject>* objects = &world.objects;
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
