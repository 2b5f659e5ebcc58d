#include <tbb/global_control.h>

#include <algorithm>
#include <random>
#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "support/absolute_difference.h"
#include "support/kernel_state.h"
#include "support/pass_result.h"
#include "support/random_views.h"

// The result does not depend on the order in which the pixels of one colour are updated.

namespace acmp {
namespace {

using Order = std::vector<std::pair<int, int>>;  ///< all pixels, col and row

/// One pass with pixels visited one by one in the given order, colour by colour.
template <Pass kPass>
EstimateState RunInOrder(KernelState* state, const Order& order, int iterations) {
  const auto context = state->Context(static_cast<uint32_t>(kPass));
  const auto for_color = [&](int color, const auto& function) {
    for (const auto& [col, row] : order) {
      if ((col + row) % 2 == color) function(col, row);
    }
  };
  for_color(1, [&](int col, int row) { InitializePixel<kPass>(context, col, row); });
  for_color(0, [&](int col, int row) { InitializeUnmatched<kPass>(context, col, row); });
  for (int iteration = 0; iteration < iterations; ++iteration) {
    for (const int color : {0, 1}) {
      for_color(color, [&](int col, int row) { UpdatePixel<kPass>(context, col, row, iteration); });
    }
  }
  for (const int color : {0, 1}) for_color(color, [&](int col, int row) { MedianFilterPixel(context, col, row); });
  return {state->planes.Clone(), state->cost.Clone()};
}

template <Pass kPass>
void ExpectOrderDoesNotMatter() {
  const std::vector<PlanarView> views = RandomViews(4, 53, 50, 1);
  Order order;
  for (int row = 0; row < 50; ++row) {
    for (int col = 0; col < 53; ++col) order.push_back({col, row});
  }
  const auto run = [&] {
    KernelState state(MakeProblem(views, 0, {1, 10}, true));
    TestRandom random(2);
    for (int row = 0; row < 50; ++row) {
      for (int col = 0; col < 53; ++col) {
        state.planes(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
        state.prior(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
        state.cost(col, row) = static_cast<float>(random(0, 0.3));
      }
    }
    return RunInOrder<kPass>(&state, order, 2);
  };
  const EstimateState forward = run();
  std::reverse(order.begin(), order.end());
  EXPECT_TRUE(SameBits(forward, run())) << "reversed";
  std::shuffle(order.begin(), order.end(), std::mt19937(3));
  EXPECT_TRUE(SameBits(forward, run())) << "shuffled";
}

TEST(PixelOrderTest, DoesNotMatterInThePhotometricPass) { ExpectOrderDoesNotMatter<Pass::kPhotometric>(); }
TEST(PixelOrderTest, DoesNotMatterInThePlanarPriorPass) { ExpectOrderDoesNotMatter<Pass::kPlanarPrior>(); }
TEST(PixelOrderTest, DoesNotMatterInTheGeometricPass) { ExpectOrderDoesNotMatter<Pass::kGeometric>(); }

/// A cost is its sums and what it makes of them: a pass with another one finds planes as well.
TEST(MatchingCostTest, AnotherOneFindsPlanes) {
  const std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(25, -15, 4), 53, 40, 4);
  KernelState state(MakeProblem(views, 0, {2, 8}));
  const auto context = state.ContextWith(AbsoluteDifferenceSampler{state.Context().sampler});
  for (int step = -1; step < 2 * 3; ++step) {
    for (int row = 0; row < 40; ++row) {
      for (int col = 0; col < 53; ++col) {
        if (step < 0) {
          InitializePixel<Pass::kPhotometric>(context, col, row);
        } else if ((col + row) % 2 == step % 2) {
          UpdatePixel<Pass::kPhotometric>(context, col, row, step / 2);
        }
      }
    }
  }
  EXPECT_GT(ShareWithin(ToDepthMap(state.planes, views[0].camera), views[0].depth, 0.02), 0.8);
}

TEST(ThreadCountTest, DoesNotMatter) {
  const std::vector<PlanarView> views = RandomViews(4, 83, 71, 4);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const auto run = [&] {
    EstimateState state = RunPhotometric(problem, {});
    const PlaneMap prior = state.planes.Clone();
    return RunGeometric(problem, {}, RunPlanarPrior(problem, {}, std::move(state), prior.View()), 0);
  };
  const auto run_with = [&](size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return run();
  };
  const EstimateState many = run_with(8);
  EXPECT_TRUE(SameBits(many, run_with(1)));
  EXPECT_TRUE(SameBits(many, run_with(3)));
}

}  // namespace
}  // namespace acmp
