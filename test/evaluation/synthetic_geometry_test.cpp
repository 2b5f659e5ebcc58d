#include "synthetic_geometry.h"

#include <algorithm>
#include <functional>
#include <utility>

#include <gtest/gtest.h>

#include "acmp_mapping/common/random.h"
#include "synthetic_world.h"

namespace acmp {
namespace {

// Inside test straight from each shape's definition, for a reference that marches along the ray.
bool Inside(const Solid& solid, const Vec3d& point) {
  const Vec3d p = RotateBack(solid.yaw, point - solid.center);
  const Vec3d& s = solid.size;
  switch (solid.shape) {
    case Shape::kBox:
    case Shape::kRoom:
      return std::abs(p.x) < s.x && std::abs(p.y) < s.y && std::abs(p.z) < s.z;
    case Shape::kSphere:
      return p.x * p.x + p.y * p.y + p.z * p.z < s.x * s.x;
    case Shape::kCylinder:
      return p.x * p.x + p.y * p.y < s.x * s.x && std::abs(p.z) < s.z;
  }
  return false;
}

constexpr double kStep = 1e-4;
constexpr double kEnd = 12.0;

// First parameter at which the march changes between outside and inside, or kEnd.
double March(const Solid& solid, const Ray& ray) {
  const bool start = Inside(solid, ray.origin);
  for (int step = 0; step * kStep < kEnd; ++step) {
    if (Inside(solid, ray.origin + step * kStep * ray.direction) != start) return step * kStep;
  }
  return kEnd;
}

Vec3d RandomVector(RandomStream* random, double range) {
  const double x = random->NextUniform(-1, 1), y = random->NextUniform(-1, 1), z = random->NextUniform(-1, 1);
  return {range * x, range * y, range * z};
}

class IntersectTest : public testing::TestWithParam<Shape> {};

TEST_P(IntersectTest, AgreesWithMarchingAlongTheRay) {
  const Solid solid = {GetParam(), {0.3, -0.2, 0.1}, {0.8, 0.5, 0.6}, {12.0 / 13.0, 5.0 / 13.0}};
  int hits = 0;
  for (uint32_t i = 0; i < 300; ++i) {
    RandomStream random(7, i, 0);
    const bool from_inside = GetParam() == Shape::kRoom;
    Ray ray = {solid.center + RandomVector(&random, from_inside ? 0.3 : 4.0), {}};
    if (!from_inside && Inside(solid, ray.origin)) continue;
    ray.direction = Normalized(RandomVector(&random, 0.9) - ray.origin);
    const double expected = March(solid, ray);
    const auto hit = Intersect(solid, ray);
    // The march cannot see a ray that grazes an edge for less than a step.
    if (!hit || expected == kEnd) {
      EXPECT_TRUE(expected == kEnd);
      if (hit) {
        EXPECT_FALSE(Inside(solid, ray.origin + (hit->t + 2 * kStep) * ray.direction));
      }
      continue;
    }
    ++hits;
    EXPECT_NEAR(hit->t, expected, 1.01 * kStep);
    EXPECT_LT(Dot(hit->normal, ray.direction), 0);
    EXPECT_NEAR(Norm(hit->normal), 1, 1e-12);
    // A small step against the normal enters the solid (leaves the room), a step along it does not.
    const Vec3d point = ray.origin + hit->t * ray.direction;
    EXPECT_NE(Inside(solid, point - 1e-7 * hit->normal), from_inside);
    EXPECT_EQ(Inside(solid, point + 1e-7 * hit->normal), from_inside);
  }
  EXPECT_GT(hits, 100);
}

INSTANTIATE_TEST_SUITE_P(Shapes, IntersectTest,
                         testing::Values(Shape::kBox, Shape::kRoom, Shape::kSphere, Shape::kCylinder));

TEST(Intersect, MissesWhatLiesBehindOrBeside) {
  const Solid box = {Shape::kBox, {0, 0, 5}, {1, 1, 1}, {}};
  EXPECT_FALSE(Intersect(box, {{0, 0, 0}, {0, 0, -1}}));
  EXPECT_FALSE(Intersect(box, {{1.5, 0, 0}, {0, 0, 1}}));  // parallel to the faces, outside
  const auto hit = Intersect(box, {{0.5, 0, 0}, {0, 0, 2}});
  ASSERT_TRUE(hit);
  EXPECT_DOUBLE_EQ(hit->t, 2.0);  // in units of the direction's length
}

class WorldTest : public testing::TestWithParam<const SyntheticWorld* (*)()> {
 protected:
  const SyntheticWorld& world_ = *GetParam()();
};

TEST_P(WorldTest, TracesTheSameAmongTheObjectsNearAPixelAsAmongAll) {
  const PinholeCamera camera = SyntheticCamera(64, 48);
  const CameraPose pose = PoseOnPath(world_.path, 2, 14, 1);
  const double margin = 0.71 * world_.diameter_m / camera.fx;
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const auto near = ObjectsNear(world_, PixelRay(camera, pose, col, row), margin);
      for (const auto& [dx, dy] :
           {std::pair{-0.5, -0.5}, std::pair{0.5, -0.5}, std::pair{-0.5, 0.5}, std::pair{0.5, 0.5}}) {
        const Ray ray = PixelRay(camera, pose, col + dx, row + dy);
        EXPECT_EQ(Trace(world_, ray, near).object, Trace(world_, ray).object) << col << " " << row;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Worlds, WorldTest,
                         testing::Values([] { return &RoomWorld(); }, [] { return &OfficeWorld(); },
                                         [] { return &StreetWorld(); }));

}  // namespace
}  // namespace acmp
