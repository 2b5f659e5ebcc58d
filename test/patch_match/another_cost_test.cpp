#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "support/absolute_difference.h"
#include "support/devices.h"
#include "support/kernel_state.h"
#include "support/random_views.h"

namespace acmp {
namespace {

TEST(AnotherCostTest, IsTheSameOnTheGpuButForRounding) {
  std::unique_ptr<DepthEngine> engine;
  MakeEngineOrSkip(Device::kCuda, &engine);
  if (IsSkipped()) return;
  constexpr int kWidth = 65, kHeight = 49, kQueries = 50000;
  const std::vector<PlanarView> views = RandomViews(5, kWidth, kHeight, 4);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(5);
  std::vector<CostQuery> queries;
  for (int i = 0; i < kQueries; ++i) {
    const int col = random.Below(kWidth), row = random.Below(kHeight);
    queries.push_back({col, row, i % 4, RandomHypothesis(views[0].camera, col, row, 1.5, 10, 75, &random)});
  }
  const auto context = state.ContextWith(AbsoluteDifferenceSampler{state.Context().sampler});
  std::vector<float> differences = CostsOnGpu(state.problem(), queries);
  for (size_t i = 0; i < queries.size(); ++i) differences[i] = std::abs(differences[i] - Cost(context, queries[i]));
  std::sort(differences.begin(), differences.end());
  // Fused products and reciprocals of two units in the last place shift samples by some 1e-5 px, and costs by some 4e-4
  // of 32 grey levels. Of what lies within rounding of an image's border, one in a thousand, either answer is right.
  EXPECT_LT(differences[kQueries / 2], 2e-5);
  EXPECT_LT(differences[kQueries - kQueries / 1000], 1e-3);
}

}  // namespace
}  // namespace acmp
