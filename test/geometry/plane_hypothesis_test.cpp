#include "acmp_mapping/geometry/plane_hypothesis.h"

#include <Eigen/Geometry>

#include "gtest/gtest.h"

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "geometry/vga_camera.h"

namespace acmp {
namespace {

TEST(PlaneHypothesisTest, RaysAreTheCamerasOwn) {
  const RayGrid rays = MakeRayGrid(kVgaCamera);
  for (const auto& [col, row] : {std::pair(0, 0), {639, 479}, {312, 244}, {17, 400}}) {
    const Eigen::Vector3d expected = kVgaCamera.Unproject({static_cast<double>(col), static_cast<double>(row)});
    const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
    EXPECT_NEAR(ray.x, expected.x(), 2e-7);  // three float roundings of a value below 1
    EXPECT_NEAR(ray.y, expected.y(), 2e-7);
    EXPECT_EQ(ray.z, 1.0f);
  }
}

/// Depth along the camera's ray by Eigen's own intersection, in double.
double ReferenceDepth(const PlaneHypothesis& plane, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
  const auto line = Eigen::ParametrizedLine<double, 3>(Eigen::Vector3d::Zero(), ray.normalized());
  return line.intersectionPoint(Eigen::Hyperplane<double, 3>(normal, plane.d)).z();
}

TEST(PlaneHypothesisTest, DepthIsWhereTheRayMeetsThePlane) {
  RandomStream random(1, 0, 0);
  int compared = 0;
  for (int i = 0; i < 500; ++i) {
    const Vec3f normal =
        Normalized(Vec3f{random.NextUniform(-1, 1), random.NextUniform(-1, 1), random.NextUniform(-1, 0)});
    const PlaneHypothesis plane = {normal.x, normal.y, normal.z, random.NextUniform(0.1f, 20.0f)};
    const Vec3f ray = {random.NextUniform(-0.6f, 0.6f), random.NextUniform(-0.5f, 0.5f), 1.0f};
    // Near edge-on, rounding of the scalar product is amplified without bound.
    if (std::abs(Dot(normal, ray)) < 0.05f) continue;
    const double expected = ReferenceDepth(plane, {ray.x, ray.y, ray.z});
    // Scalar product: 4 roundings of at most 6e-8 on terms of size 1, divided by at least 0.05.
    EXPECT_NEAR(PlaneDepth(plane, ray) / expected, 1.0, 1e-5);
    ++compared;
  }
  EXPECT_GT(compared, 400);
}

TEST(PlaneHypothesisTest, PlaneThroughAPointHasItsDepthAndNormal) {
  RandomStream random(2, 0, 0);
  for (int i = 0; i < 500; ++i) {
    const Vec3f ray = {random.NextUniform(-0.6f, 0.6f), random.NextUniform(-0.5f, 0.5f), 1.0f};
    Vec3f normal = Normalized(Vec3f{random.NextUniform(-1, 1), random.NextUniform(-1, 1), random.NextUniform(-1, 1)});
    if (Dot(normal, ray) > 0) normal = -1.0f * normal;
    const float depth = random.NextUniform(0.1f, 50.0f);
    const PlaneHypothesis plane = PlaneThrough(normal, ray, depth);
    EXPECT_GT(plane.d, 0);  // faces the camera and lies in front of it
    EXPECT_EQ(plane.nx, normal.x);
    EXPECT_EQ(plane.ny, normal.y);
    EXPECT_EQ(plane.nz, normal.z);
    // The same scalar product is multiplied and divided: two roundings remain.
    EXPECT_NEAR(PlaneDepth(plane, ray) / depth, 1.0, 2e-7);
    const Eigen::Vector3d point = depth * Eigen::Vector3d(ray.x, ray.y, 1);
    EXPECT_NEAR(point.dot(Eigen::Vector3d(plane.nx, plane.ny, plane.nz)) + plane.d, 0, 1e-6 * depth);
  }
}

TEST(PlaneHypothesisTest, PlanesThatMissTheRayHaveNoPositiveFiniteDepth) {
  const Vec3f ray = {0, 0, 1};
  EXPECT_FALSE(std::isfinite(PlaneDepth({1, 0, 0, 2}, ray)));  // edge-on
  EXPECT_LT(PlaneDepth({0, 0, 1, 2}, ray), 0);                 // behind the camera
  EXPECT_FALSE(PlaneDepth({}, ray) > 0);                       // no hypothesis
}

}  // namespace
}  // namespace acmp
