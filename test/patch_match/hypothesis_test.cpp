#include "acmp_mapping/patch_match/kernel/hypothesis.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gtest/gtest.h"

#include "support/angles.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

Eigen::Vector3d ToEigen(const Vec3f& v) { return {v.x, v.y, v.z}; }

/// Pearson's statistic of values in [0, 1) against a uniform distribution, in 20 cells.
double ChiSquare(const std::vector<double>& values) {
  constexpr int kCells = 20;
  std::vector<int> counts(kCells);
  for (const double value : values) ++counts[std::clamp(static_cast<int>(value * kCells), 0, kCells - 1)];
  const double expected = static_cast<double>(values.size()) / kCells;
  double sum = 0;
  for (const int count : counts) sum += (count - expected) * (count - expected) / expected;
  return sum;
}
constexpr double kChiSquareLimit = 19 + 5 * 6.16;  // mean + 5 standard deviations at 19 degrees of freedom

TEST(RandomDepthTest, IsUniformInInverseDepthAndInRange) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 1);
  for (const auto& [low, high] : {std::pair(0.5f, 20.0f), {3.0f, 3.1f}, {1e-3f, 1e4f}}) {
    KernelState state(MakeProblem(views, 0, {low, high}));
    std::vector<double> shares;
    for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
      RandomStream random(1, pixel, 0);
      const float depth = RandomDepth(state.Context(), &random);
      ASSERT_GE(depth, low);
      ASSERT_LE(depth, high);
      shares.push_back((1.0 / low - 1.0 / depth) / (1.0 / low - 1.0 / high));
    }
    EXPECT_LT(ChiSquare(shares), kChiSquareLimit) << low << ".." << high;
  }
}

TEST(RandomNormalTest, IsUniformOnTheHalfSphereFacingTheCamera) {
  for (const Vec3f& ray : {Vec3f{0, 0, 1}, Vec3f{0.6f, -0.4f, 1}, Vec3f{-1.2f, 0.9f, 1}}) {
    // Uniform on the half sphere about the direction toward the camera: height above its base is uniform (Archimedes),
    // azimuth is uniform.
    const Eigen::Vector3d toward = -ToEigen(ray).normalized();
    const Eigen::Vector3d side = toward.unitOrthogonal();
    std::vector<double> heights, azimuths;
    for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
      RandomStream random(1, pixel, 0);
      const Vec3f normal = RandomNormal(ray, &random);
      ASSERT_NEAR(ToEigen(normal).norm(), 1, 1e-6);
      ASSERT_LE(Dot(normal, ray), 0);
      heights.push_back(ToEigen(normal).dot(toward));
      const double angle = std::atan2(ToEigen(normal).dot(toward.cross(side)), ToEigen(normal).dot(side));
      azimuths.push_back(angle / (360 * kRad) + 0.5);
    }
    EXPECT_LT(ChiSquare(heights), kChiSquareLimit);
    EXPECT_LT(ChiSquare(azimuths), kChiSquareLimit);
  }
}

/// Bound on the angle between a vector and the same turned by up to `max_deg` about each of three axes.
double MaxTurn(double max_deg) { return 3 * max_deg; }

TEST(PerturbNormalTest, TurnsByAtMostTheAngleAboutEachAxis) {
  TestRandom cases(2);
  for (const double max_deg : {1.8, 2.5, 5.4, 30.0}) {
    double largest = 0, smallest = 180;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (uint32_t pixel = 0; pixel < 5000; ++pixel) {
      RandomStream random(3, pixel, 0);
      const Vec3f ray = {static_cast<float>(cases(-0.5, 0.5)), static_cast<float>(cases(-0.5, 0.5)), 1};
      const Vec3f normal = {0.28f, -0.36f, -std::sqrt(1 - 0.28f * 0.28f - 0.36f * 0.36f)};
      const Vec3f turned = PerturbNormal(normal, ray, static_cast<float>(max_deg * kRad), &random);
      ASSERT_NEAR(ToEigen(turned).norm(), 1, 1e-6);
      ASSERT_LT(Dot(turned, ray), 0);
      const double angle = std::acos(std::min(1.0, ToEigen(turned).dot(ToEigen(normal)))) / kRad;
      ASSERT_LE(angle, MaxTurn(max_deg) + 0.05);  // acos near 1 in float: 0.02 degrees
      largest = std::max(largest, angle);
      smallest = std::min(smallest, angle);
      mean += ToEigen(turned) - ToEigen(normal);
    }
    EXPECT_GT(largest, max_deg);       // it does use the whole interval ...
    EXPECT_LT(smallest, max_deg / 4);  // ... down to small angles
    // ... to all sides: the mean stays within 5 standard errors (about max / sqrt(3 * 5000)) and the shrinking of a
    // vector averaged over turns (max^2 / 3).
    EXPECT_LT((mean / 5000).norm(), 5 * max_deg * kRad / std::sqrt(15000) + std::pow(max_deg * kRad, 2) / 3);
  }
}

TEST(PerturbNormalTest, EachAxisAloneIsUniform) {
  // For small angles a turn about x moves the normal (0, 0, -1) along y and one about y along x.
  std::vector<double> along_x, along_y;
  for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
    RandomStream random(4, pixel, 0);
    const Vec3f turned = PerturbNormal({0, 0, -1}, {0, 0, 1}, 1e-2f, &random);
    along_x.push_back(0.5 + 0.5 * turned.x / 1e-2);
    along_y.push_back(0.5 + 0.5 * turned.y / 1e-2);
  }
  EXPECT_LT(ChiSquare(along_x), kChiSquareLimit);
  EXPECT_LT(ChiSquare(along_y), kChiSquareLimit);
}

TEST(PerturbNormalTest, NeverTurnsAwayFromTheCamera) {
  // A nearly edge-on normal: half of the turns would leave the half sphere.
  const Vec3f ray = {0, 0, 1};
  const Vec3f normal = {0.9999f, 0, -std::sqrt(1 - 0.9999f * 0.9999f)};
  int kept = 0;
  for (uint32_t pixel = 0; pixel < 2000; ++pixel) {
    RandomStream random(5, pixel, 0);
    const Vec3f turned = PerturbNormal(normal, ray, 0.1f, &random);
    ASSERT_LT(Dot(turned, ray), 0);
    kept += turned.x == normal.x && turned.y == normal.y && turned.z == normal.z;
  }
  EXPECT_GT(kept, 200);
  EXPECT_LT(kept, 1800);
}

}  // namespace
}  // namespace acmp
