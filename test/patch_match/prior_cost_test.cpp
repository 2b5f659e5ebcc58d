#include "acmp_mapping/patch_match/kernel/prior_cost.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

#include "support/angles.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

PixelPrior MakePrior(double depth) {
  PixelPrior prior;
  prior.valid = true;
  prior.normal = {0, 0, -1};
  prior.depth = static_cast<float>(depth);
  prior.lambda_depth = 0.1f;
  prior.lambda_normal = static_cast<float>(5 * kRad);
  return prior;
}

/// Unit normal `angle_deg` away from (0, 0, -1).
Vec3f Tilted(double angle_deg) {
  return {static_cast<float>(std::sin(angle_deg * kRad)), 0, static_cast<float>(-std::cos(angle_deg * kRad))};
}

TEST(PriorCostTest, ProbabilityIsEquation6WithStandardDeviations) {
  const PixelPrior prior = MakePrior(4);
  for (const double depth : {3.0, 3.8, 3.95, 4.0, 4.05, 4.3}) {
    for (const double angle_deg : {0.0, 2.0, 5.0, 12.0, 60.0, 180.0}) {
      const double expected = reference::PriorProbability(depth - 4, angle_deg * kRad, 0.1, 5 * kRad, 0.5);
      // acos near 1 has a float error of sqrt(2^-23) = 3.5e-4 rad, 0.004 standard deviations.
      EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, static_cast<float>(depth), Tilted(angle_deg)), expected,
                  1e-4)
          << depth << ", " << angle_deg;
    }
  }
  EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, 4, Tilted(0)), 1.5, 1e-5);
  EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, 4.1f, Tilted(0)), 0.5 + std::exp(-0.5),
              1e-4);  // one standard deviation
  EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, 4, Tilted(5)), 0.5 + std::exp(-0.5), 1e-4);
}

TEST(PriorCostTest, GammaAloneWithoutPrior) {
  EXPECT_EQ(PriorProbability<Method::kOurs>(PixelPrior{}, 0.5f, 4, Tilted(0)), 0.5f);
  EXPECT_EQ(PriorProbability<Method::kOurs>(PixelPrior{}, 0.25f, 4, Tilted(0)), 0.25f);
}

TEST(PriorCostTest, ScalarProductsBeyondOneAreNoNan) {
  // Unit vectors in float may have a product of 1 + 1e-7, for which acos is not defined.
  PixelPrior prior = MakePrior(4);
  prior.normal = {0, 0, -1.0000001f};
  EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, 4, {0, 0, -1.0000001f}), 1.5, 1e-5);
  EXPECT_NEAR(PriorProbability<Method::kOurs>(prior, 0.5f, 4, {0, 0, 1.0000001f}), 0.5, 1e-5);
}

TEST(PriorCostTest, CostIsEquation7) {
  for (const double cost : {0.0, 0.05, 0.3, 1.0, 2.0}) {
    for (const double probability : {0.5, 0.8, 1.5}) {
      for (const double alpha : {0.18, 1.0}) {
        EXPECT_NEAR(
            PriorAssistedCost(static_cast<float>(cost), static_cast<float>(probability), static_cast<float>(alpha)),
            reference::PriorAssistedCost(cost, probability, alpha), 1e-5 * (1 + cost * cost / alpha));
      }
    }
  }
}

TEST(LoadPriorTest, GivesThePriorsDepthAtThePixel) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 1);
  PatchMatchOptions options;
  options.prior_sigma_normal_deg = 7;
  options.prior_depth_divisor = 32;
  KernelState state(MakeProblem(views, 0, {1.5f, 9.5f}), options);
  TestRandom random(2);
  for (int i = 0; i < 200; ++i) {
    const int col = random.Below(33), row = random.Below(27);
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
    state.prior(col, row) = plane;
    const auto context = state.Context();
    const PixelPrior prior =
        LoadPrior(context, col, row, context.rays.Ray(static_cast<float>(col), static_cast<float>(row)));
    ASSERT_TRUE(prior.valid);
    EXPECT_NEAR(prior.depth,
                reference::Intersect(views[0].camera, Eigen::Vector2d(col, row), reference::ToDouble(plane)).z(), 1e-4);
    EXPECT_EQ(prior.normal.x, plane.nx);
    EXPECT_NEAR(prior.lambda_depth, 8.0 / 32, 1e-6);  // depth interval / divisor
    EXPECT_NEAR(prior.lambda_normal, 7 * kRad, 1e-6);
  }
}

TEST(LoadPriorTest, ZeroPlaneIsNoPrior) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 1);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  EXPECT_FALSE(LoadPrior(state.Context(), 5, 6, {0, 0, 1}).valid);
  state.prior(5, 6).d = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(LoadPrior(state.Context(), 5, 6, {0, 0, 1}).valid);
}

TEST(PriorMapTest, NumbersSayWhichPlaneIsAPixels) {
  const PlaneHypothesis planes[] = {{0, 0, -1, 2}, {0, 0, -1, 5}};
  Image<uint32_t> numbers(3, 2, 0);
  numbers(1, 0) = 2;
  numbers(2, 1) = 1;
  const PriorMap map = {{planes, 2, 1, 2}, numbers.View()};
  EXPECT_EQ(map(1, 0).d, 5);
  EXPECT_EQ(map(2, 1).d, 2);
  EXPECT_EQ(map(0, 0).d, 0);
}

}  // namespace
}  // namespace acmp
