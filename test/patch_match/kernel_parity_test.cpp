#include "kernel_parity.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "kernel_parity_answer.h"
#include "support/devices.h"
#include "support/kernel_state.h"
#include "support/random_views.h"

// The same per-pixel functions compiled by both compilers, call by call.

namespace acmp {

std::vector<ParityAnswer> AnswerOnCpu(const PatchMatchProblem& problem, const std::vector<ParityQuery>& queries) {
  KernelState state(problem);
  const auto context = state.Context();
  const auto other = state.ContextWith(AbsoluteDifferenceSampler{context.sampler});
  std::vector<ParityAnswer> answers;
  answers.reserve(queries.size());
  for (const ParityQuery& query : queries) answers.push_back(Answer(context, other, query));
  return answers;
}

namespace {

constexpr int kWidth = 65, kHeight = 49, kQueries = 50000;

class KernelParityTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::unique_ptr<DepthEngine> engine;
    MakeEngineOrSkip(Device::kCuda, &engine);
    if (IsSkipped()) return;
    views_ = RandomViews(5, kWidth, kHeight, 4);
    problem_ = MakeProblem(views_, 0, {1, 10}, true);
    TestRandom random(5);
    for (int i = 0; i < kQueries; ++i) {
      const int col = random.Below(kWidth), row = random.Below(kHeight);
      queries_.push_back({col, row, i % 4, RandomHypothesis(views_[0].camera, col, row, 1.5, 10, 75, &random)});
    }
    cpu_ = AnswerOnCpu(problem_, queries_);
    gpu_ = AnswerOnGpu(problem_, queries_);
  }

  /// Differences of one value over all queries, ascending.
  template <class Difference>
  std::vector<double> Sorted(const Difference& difference) const {
    std::vector<double> sorted;
    sorted.reserve(kQueries);
    for (int i = 0; i < kQueries; ++i) sorted.push_back(difference(cpu_[i], gpu_[i]));
    std::sort(sorted.begin(), sorted.end());
    return sorted;
  }

  std::vector<PlanarView> views_;
  PatchMatchProblem problem_;
  std::vector<ParityQuery> queries_;
  std::vector<ParityAnswer> cpu_, gpu_;
};

/// A decision within rounding of its threshold (a point on the image border, a variance at the floor) may go the other
/// way: at most one query in a thousand.
constexpr int kUndecided = kQueries / 1000;

TEST_F(KernelParityTest, DrawnViewsAreTheSameAndNeverImpossible) {
  int differing = 0;
  for (int i = 0; i < kQueries; ++i) {
    ASSERT_EQ(gpu_[i].impossible_views, 0u);
    ASSERT_EQ(cpu_[i].impossible_views, 0u);
    ASSERT_TRUE(gpu_[i].draws == 255 || (gpu_[i].draws == 0 && gpu_[i].drawn_views == 0));
    differing += cpu_[i].drawn_views != gpu_[i].drawn_views;
  }
  EXPECT_LE(differing, kUndecided);
}

TEST_F(KernelParityTest, CostsWithExplicitInterpolationDifferByRounding) {
  const auto differences =
      Sorted([](const ParityAnswer& a, const ParityAnswer& b) { return std::abs(a.bilinear_cost - b.bilinear_cost); });
  // Both are within 5e-4 of the double-precision reference (view_cost_test.cpp): fused products and reciprocals
  // of two units in the last place shift samples of 65 px images by some 1e-5 px.
  EXPECT_LT(differences[kQueries / 2], 2e-5);
  EXPECT_LT(differences[kQueries - kUndecided], 1e-3);
}

TEST_F(KernelParityTest, AnotherCostDiffersByRounding) {
  const auto differences =
      Sorted([](const ParityAnswer& a, const ParityAnswer& b) { return std::abs(a.other_cost - b.other_cost); });
  // Samples shifted by 1e-5 px differ by some 4e-4 of 32 grey levels.
  EXPECT_LT(differences[kQueries / 2], 2e-5);
  EXPECT_LT(differences[kQueries - kUndecided], 1e-3);
}

TEST_F(KernelParityTest, CostsWithTexturesDifferByTheirEightBitFractions) {
  const auto differences =
      Sorted([](const ParityAnswer& a, const ParityAnswer& b) { return std::abs(a.bilinear_cost - b.texture_cost); });
  // Positions are off by up to 1/512 px, at gradients of about 40 grey levels per px that is 0.08 grey levels of a
  // standard deviation of about 25, independently for each of 36 samples.
  EXPECT_LT(differences[kQueries / 2], 2e-3);
  EXPECT_LT(differences[kQueries * 99 / 100], 1e-2);
  EXPECT_LT(differences[kQueries - kUndecided], 5e-2);
  // But not the same arithmetic: equality would mean that no texture was read.
  EXPECT_GT(differences[kQueries * 9 / 10], 0);
}

TEST_F(KernelParityTest, GeometricErrorsDifferByRounding) {
  const auto differences = Sorted(
      [](const ParityAnswer& a, const ParityAnswer& b) { return std::abs(a.geometric_error - b.geometric_error); });
  // Pixels of about 65 px, forward and backward. A source pixel read on the other side of a half is another depth.
  EXPECT_LT(differences[kQueries - kUndecided], 1e-3);
}

}  // namespace
}  // namespace acmp
