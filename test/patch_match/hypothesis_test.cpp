#include "acmp_mapping/patch_match/kernel/hypothesis.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr double kRad = 3.14159265358979323846 / 180;

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

TEST(RandomDepthTest, OptionMakesItUniformInDepth) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 1);
  PatchMatchOptions options;
  options.sample_inverse_depth = false;
  KernelState state(MakeProblem(views, 0, {0.5f, 20.0f}), options);
  std::vector<double> shares;
  for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
    RandomStream random(1, pixel, 0);
    const float depth = RandomDepth(state.Context(), &random);
    ASSERT_TRUE(depth >= 0.5f && depth <= 20.0f);
    shares.push_back((depth - 0.5) / 19.5);
  }
  EXPECT_LT(ChiSquare(shares), kChiSquareLimit);
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

/// A state whose planes all pass through the points of one surface, given by its depth at each pixel.
template <class Depth>
void SetSurface(KernelState* state, const PinholeCamera& camera, const Depth& depth) {
  TestRandom random(6);
  for (int row = 0; row < state->height(); ++row) {
    for (int col = 0; col < state->width(); ++col) {
      const double z = depth(col, row);
      // Random normals: the gradient must come from the depths alone.
      state->planes(col, row) = RandomHypothesis(camera, col, row, z, z, 70, &random);
    }
  }
}

TEST(GradientNormalTest, IsTheSurfacesNormal) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 7);
  const PinholeCamera& camera = views[0].camera;
  KernelState state(MakeProblem(views, 0, {1, 10}));
  for (const auto& [tilt_x, tilt_y] : {std::pair(0.0, 0.0), {30.0, -20.0}, {-55.0, 10.0}}) {
    const WorldPlane plane = WorldPlane::Slanted(tilt_x, tilt_y, 4);  // world = camera frame of the first view
    SetSurface(&state, camera, [&](int col, int row) {
      return -plane.d / plane.normal.dot(camera.Unproject({1.0 * col, 1.0 * row}));
    });
    const auto context = state.Context();
    for (int row = 1; row < 26; ++row) {
      for (int col = 1; col < 32; ++col) {
        const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
        const Vec3f normal = GradientNormal(context, col, row, ray, {9, 9, 9});
        // Differences of points about 0.25 m apart whose depths round to 1e-6.
        ASSERT_LT((ToEigen(normal) - plane.normal).norm(), 1e-4) << col << ", " << row;
      }
    }
  }
}

TEST(GradientNormalTest, UsesTheFourNeighboursOnly) {
  const std::vector<PlanarView> views = RandomViews(2, 9, 9, 8);
  const PinholeCamera& camera = views[0].camera;
  KernelState state(MakeProblem(views, 0, {1, 10}));
  SetSurface(&state, camera, [&](int col, int row) { return 3.0 + 0.1 * col + 0.05 * row * col; });
  const auto point = [&](int col, int row) -> Eigen::Vector3d {
    return reference::Intersect(camera, Eigen::Vector2d(col, row), reference::ToDouble(state.planes(col, row)));
  };
  Eigen::Vector3d expected = (point(5, 4) - point(3, 4)).cross(point(4, 5) - point(4, 3)).normalized();
  if (expected.dot(point(4, 4)) > 0) expected = -expected;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (int row = 0; row < 9; ++row) {
    for (int col = 0; col < 9; ++col) {
      if (std::abs(col - 4) + std::abs(row - 4) != 1) state.planes(col, row) = {nan, nan, nan, nan};
    }
  }
  const auto context = state.Context();
  const Vec3f normal = GradientNormal(context, 4, 4, context.rays.Ray(4, 4), {9, 9, 9});
  EXPECT_LT((ToEigen(normal) - expected).norm(), 1e-5);
}

TEST(GradientNormalTest, FallsBackAtBordersAndOnDegenerateNeighbours) {
  const std::vector<PlanarView> views = RandomViews(2, 9, 7, 9);
  const PinholeCamera& camera = views[0].camera;
  KernelState state(MakeProblem(views, 0, {1, 10}));
  SetSurface(&state, camera, [](int, int) { return 4.0; });
  const Vec3f fallback = {0.6f, 0, -0.8f};
  const auto gradient = [&](int col, int row) {
    const auto context = state.Context();
    return GradientNormal(context, col, row, context.rays.Ray(static_cast<float>(col), static_cast<float>(row)),
                          fallback);
  };
  for (const auto& [col, row] : {std::pair(0, 3), {8, 3}, {4, 0}, {4, 6}, {0, 0}, {8, 6}}) {
    EXPECT_EQ(gradient(col, row).x, fallback.x) << col << ", " << row;
  }
  EXPECT_NE(gradient(1, 1).x, fallback.x);
  EXPECT_NE(gradient(7, 5).x, fallback.x);
  state.planes(5, 3) = {1, 0, 0, 1e-30f};  // passes through the camera's centre: depth 0 or infinite
  state.planes(3, 3) = {0, 0, 0, 0};       // none: depth is NaN
  EXPECT_EQ(gradient(4, 3).x, fallback.x);
}

TEST(GradientNormalTest, FacesTheCamera) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 10);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(11);
  SetSurface(&state, views[0].camera, [&](int, int) { return random(1, 10); });
  const auto context = state.Context();
  for (int row = 0; row < 27; ++row) {
    for (int col = 0; col < 33; ++col) {
      const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
      const Vec3f normal = GradientNormal(context, col, row, ray, {0, 0, -1});
      ASSERT_LT(Dot(normal, ray), 0);
      ASSERT_NEAR(ToEigen(normal).norm(), 1, 1e-5);
    }
  }
}

}  // namespace
}  // namespace acmp
