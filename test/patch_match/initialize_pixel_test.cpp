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

struct ViewCost {
  double cost;
  int view;
};

/// Costs of the views that count, ascending.
std::vector<ViewCost> ReferenceCosts(const KernelState& state, const PlaneHypothesis& plane, int col, int row,
                                     bool geometric) {
  std::vector<ViewCost> costs;
  const double depth =
      reference::Intersect(state.problem().reference.camera, Eigen::Vector2d(col, row), reference::ToDouble(plane)).z();
  for (int j = 0; j < static_cast<int>(state.problem().sources.size()); ++j) {
    const auto cost =
        reference::PhotometricCost(state.problem(), state.options(), reference::ToDouble(plane), col, row, j);
    if (cost.value >= 2 || cost.min_z <= 0) continue;
    const double error = std::min(3.0, reference::ReprojectionError(state.problem(), depth, col, row, j));
    costs.push_back({cost.value + (geometric ? 0.2 * error : 0), j});
  }
  std::sort(costs.begin(), costs.end(), [](const ViewCost& a, const ViewCost& b) { return a.cost < b.cost; });
  return costs;
}

template <Pass kPass>
void ExpectInitialCostsAgree() {
  const std::vector<PlanarView> views = RandomViews(8, 33, 27, 1);
  KernelState state(MakeProblem(views, 0, {1, 10}, true));
  TestRandom random(2);
  int by_count[5] = {}, compared = 0;
  for (int i = 0; i < 4000; ++i) {
    const int col = random.Below(33), row = random.Below(27);
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 0.4, 10, 70, &random);
    const std::vector<ViewCost> costs = ReferenceCosts(state, plane, col, row, kPass == Pass::kGeometric);
    const size_t used = std::min<size_t>(4, costs.size());
    uint32_t mask = 0, expected_mask = 0;
    const float cost = InitialCost<kPass>(state.Context(), col, row, plane, &mask);
    double expected = 0;
    for (size_t k = 0; k < used; ++k) {
      expected += costs[k].cost / static_cast<double>(used);
      expected_mask |= 1u << costs[k].view;
    }
    if (used == 0) expected = 2;
    // Sampling rounding (photometric_cost_test.cpp), and a source pixel read on the other side of a half (0.2 * 3 px).
    const bool close = std::abs(cost - expected) < 1e-3;
    compared += close;
    const bool tie = costs.size() > 4 && costs[4].cost - costs[3].cost < 2e-3;
    if (close && !tie) {
      ASSERT_EQ(mask, expected_mask) << i;
    }
    ++by_count[used];
  }
  EXPECT_GE(compared, 3980);                              // 0.5 % for roundings across a half pixel
  for (const int count : by_count) EXPECT_GT(count, 20);  // no valid view up to four of more
}

TEST(InitialCostTest, PhotometricIsTheMeanOfTheFourBest) { ExpectInitialCostsAgree<Pass::kPhotometric>(); }
TEST(InitialCostTest, GeometricAddsTheReprojectionError) { ExpectInitialCostsAgree<Pass::kGeometric>(); }

TEST(InitialCostTest, NoValidViewIsTheWorstCostAndNoMask) {
  std::vector<PlanarView> views = RandomViews(3, 33, 27, 3);
  for (size_t i = 1; i < 3; ++i)
    views[i].cam_from_world = LookAhead({0.0, 0.0, 0.1 * static_cast<double>(i)}, 180, 0, 0);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  uint32_t mask = 0xffffffffu;
  EXPECT_EQ(InitialCost<Pass::kPhotometric>(state.Context(), 16, 13, {0, 0, -1, 4}, &mask), kWorstCost);
  EXPECT_EQ(mask, 0u);
}

TEST(InitialCostTest, ThirtyTwoViewsUseTheTopBit) {
  std::vector<PlanarView> views = RenderPlanarScene(WorldPlane{}, 40, 30, 33);
  // All but the last five look away.
  for (size_t i = 1; i < 28; ++i)
    views[i].cam_from_world = LookAhead({0.1, 0, 0.01 * static_cast<double>(i)}, 180, 0, 0);
  KernelState state(MakeProblem(views, 0, {2, 8}));
  uint32_t mask = 0;
  InitialCost<Pass::kPhotometric>(state.Context(), 20, 15, {0, 0, -1, 4}, &mask);
  EXPECT_EQ(mask & 0x07ffffffu, 0u);
  int bits = 0;
  for (int j = 27; j < 32; ++j) bits += (mask >> j) & 1;
  EXPECT_EQ(bits, 4);
}

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

TEST(PriorStartTest, PixelsWithoutPriorKeepTheirEstimate) {
  PriorStartCase c;
  c.state.prior(20, 9) = {};
  EXPECT_TRUE(Same(c.Start(2.0f, 1), c.start));
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
