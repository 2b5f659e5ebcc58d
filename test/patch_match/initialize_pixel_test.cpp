#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"

#include <algorithm>
#include <cmath>

#include "gtest/gtest.h"

#include "support/angles.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

/// Start, prior and cost maps of a planar-prior pass at one pixel.
struct PriorStartCase {
  explicit PriorStartCase(const PatchMatchOptions& options = {})
      : views(RandomViews(2, 33, 27, 6)), state(MakeProblem(views, 0, {1, 10}), options) {
    TestRandom random(7);
    start = RandomHypothesis(views[0].camera, 20, 9, 2, 8, 60, &random);
    prior = RandomHypothesis(views[0].camera, 20, 9, 3, 5, 30, &random);
    state.planes(20, 9) = start;
    state.prior(20, 9) = prior;
  }
  PlaneHypothesis Start(float cost, uint32_t seed) {
    state.cost(20, 9) = cost;
    const auto context = state.Context(1);
    RandomStream random(seed, 0, 0);
    return PriorStart(context, 20, 9, context.rays.Ray(20, 9), &random);
  }
  double Depth(const PlaneHypothesis& plane) const {
    return reference::Intersect(views[0].camera, {20, 9}, reference::ToDouble(plane)).z();
  }

  std::vector<PlanarView> views;
  KernelState state;
  PlaneHypothesis start, prior;
};

TEST(PriorStartTest, CrediblePixelsKeepTheirEstimate) {
  PriorStartCase c;
  for (const float cost : {0.0f, 0.05f, 0.0999f}) EXPECT_TRUE(Same(c.Start(cost, 1), c.start));
  EXPECT_FALSE(Same(c.Start(0.1f, 1), c.start));  // the threshold itself is not credible
  EXPECT_FALSE(Same(c.Start(2.0f, 1), c.start));
}

TEST(PriorStartTest, OthersStartNearThePrior) {
  PriorStartCase c;
  const double prior_depth = c.Depth(c.prior);
  double least = 9, most = 0, widest = 0;
  for (uint32_t seed = 0; seed < 3000; ++seed) {
    const PlaneHypothesis plane = c.Start(0.5f, seed);
    ASSERT_GT(plane.d, 0);
    const double ratio = c.Depth(plane) / prior_depth;
    ASSERT_NEAR(ratio, 1, 0.06 + 1e-5);
    const double angle = std::acos(std::min(1.0f, Dot(plane.normal(), c.prior.normal()))) / kRad;
    ASSERT_LE(angle, 3 * 5.4 + 0.05);
    least = std::min(least, ratio);
    most = std::max(most, ratio);
    widest = std::max(widest, angle);
  }
  EXPECT_LT(least, 0.945);  // the whole +-6 % and +-5.4 degrees are used
  EXPECT_GT(most, 1.055);
  EXPECT_GT(widest, 5.4);
}

TEST(PriorStartTest, DepthStaysInRange) {
  PriorStartCase c;
  TestRandom random(8);
  c.state.prior(20, 9) = RandomHypothesis(c.views[0].camera, 20, 9, 9.99, 9.99, 20, &random);
  for (uint32_t seed = 0; seed < 500; ++seed) ASSERT_LE(c.Depth(c.Start(0.5f, seed)), 10 * (1 + 1e-6));
  c.state.prior(20, 9) = RandomHypothesis(c.views[0].camera, 20, 9, 1.001, 1.001, 20, &random);
  for (uint32_t seed = 0; seed < 500; ++seed) ASSERT_GE(c.Depth(c.Start(0.5f, seed)), 1 - 1e-6);
}

template <Pass kPass>
void ExpectSamePlaneWithoutComparison() {
  const std::vector<PlanarView> views = RandomViews(3, 33, 21, 41);
  const auto make_state = [&] {
    KernelState state(MakeProblem(views, 0, {1, 10}, true));
    TestRandom random(42);
    for (int row = 0; row < 21; ++row) {
      for (int col = 0; col < 33; ++col) {
        state.planes(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
        state.prior(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
        state.cost(col, row) = 0.25f;
        state.selected_views(col, row) = 3;
      }
    }
    return state;
  };
  KernelState matched = make_state(), unmatched = make_state();
  for (int row = 0; row < 21; ++row) {
    for (int col = 0; col < 33; ++col) {
      InitializePixel<kPass>(matched.Context(static_cast<uint32_t>(kPass)), col, row);
      InitializeUnmatched<kPass>(unmatched.Context(static_cast<uint32_t>(kPass)), col, row);
      ASSERT_EQ(unmatched.planes(col, row).nx, matched.planes(col, row).nx);
      ASSERT_EQ(unmatched.planes(col, row).d, matched.planes(col, row).d);
      ASSERT_EQ(unmatched.cost(col, row), kWorstCost);
      ASSERT_EQ(unmatched.selected_views(col, row), 0u);
    }
  }
}

TEST(InitializePixelTest, TheColourUpdatedFirstGetsTheSamePlanesWithoutComparison) {
  ExpectSamePlaneWithoutComparison<Pass::kPhotometric>();
  ExpectSamePlaneWithoutComparison<Pass::kPlanarPrior>();
  ExpectSamePlaneWithoutComparison<Pass::kGeometric>();
}

}  // namespace
}  // namespace acmp
