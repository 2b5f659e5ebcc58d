#include "acmp_mapping/patch_match/kernel/view_weights.h"

#include <cmath>
#include <numeric>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"

namespace acmp {
namespace {

/// w(I_j) of ACMH where it is not 0, `otherwise` where the costs are neither good nor bad.
/// @param decisive how many are good or bad enough, 3 in ACMH
double ReferenceConfidence(const std::vector<double>& costs, int iteration, int decisive, double otherwise) {
  const double tau = 0.8 * std::exp(-iteration * iteration / 90.0);
  int good = 0, bad = 0;
  double sum = 0;
  for (const double cost : costs) {
    if (cost < tau) {
      ++good;
      sum += std::exp(-cost * cost / (2 * 0.3 * 0.3));
    }
    if (cost > 1.2) ++bad;
  }
  if (good >= decisive && bad < decisive) return sum / good;
  return bad < decisive ? otherwise : 0;
}

/// As in the kernel, the costs of one view are not contiguous.
constexpr int kStride = 5;
std::vector<float> Strided(const std::vector<double>& costs) {
  std::vector<float> strided(costs.size() * kStride + 1, -1e9f);
  for (size_t i = 0; i < costs.size(); ++i) strided[i * kStride] = static_cast<float>(costs[i]);
  return strided;
}

template <Method kMethod>
float Confidence(const std::vector<double>& costs, int iteration, int decisive) {
  return MeanConfidence<kMethod>(Strided(costs).data(), kStride, static_cast<int>(costs.size()), iteration, decisive,
                                 {});
}

TEST(MeanConfidenceTest, AgreesWithTheReference) {
  TestRandom random(1);
  int zero = 0, floor = 0, mean = 0;
  for (int i = 0; i < 5000; ++i) {
    std::vector<double> costs(random.Below(10));
    const double worst = random(0.3, 2.0);
    for (double& cost : costs) cost = static_cast<float>(random(0, worst));
    const int iteration = random.Below(20), decisive = 2 + i % 2;
    const double tau = 0.8 * std::exp(-iteration * iteration / 90.0), least = std::exp(-tau * tau / 0.32);
    const double expected = ReferenceConfidence(costs, iteration, decisive, least);
    ASSERT_NEAR(Confidence<Method::kOurs>(costs, iteration, decisive), expected, 1e-5);
    ASSERT_NEAR(Confidence<Method::kAcmh>(costs, iteration, decisive),
                ReferenceConfidence(costs, iteration, decisive, 0), 1e-5);
    ++(expected == 0 ? zero : expected == least ? floor : mean);
  }
  EXPECT_GT(zero, 100);
  EXPECT_GT(floor, 100);
  EXPECT_GT(mean, 100);
}

TEST(IsViewRejectedTest, EnoughBadCostsRejectAsTheConfidenceDoes) {
  TestRandom random(2);
  int rejected = 0;
  for (int i = 0; i < 2000; ++i) {
    std::vector<float> costs(4);
    for (float& cost : costs) cost = static_cast<float>(random(0.5, 1.8));
    for (const RegionRange& regions : {kAllRegions, AlternatingRegions(0, 0, 0)}) {
      const int decisive = DecisiveCosts(regions);
      EXPECT_EQ(decisive, regions.count == 8 ? 3 : 2);
      const bool is_rejected = IsViewRejected(costs.data(), 1, 4, decisive);
      EXPECT_EQ(is_rejected, MeanConfidence<Method::kOurs>(costs.data(), 1, 4, 0, decisive, {}) == 0);
      rejected += is_rejected ? 1 : 0;
    }
  }
  EXPECT_GT(rejected, 500);
  EXPECT_LT(rejected, 3500);
}

uint32_t RandomMask(TestRandom* random) {
  return static_cast<uint32_t>(random->Below(65536)) << 16 | static_cast<uint32_t>(random->Below(65536));
}

/// A problem with this many sources, for the masks alone.
PatchMatchProblem ProblemWithSources(const std::vector<PlanarView>& views, int sources) {
  PatchMatchProblem problem = MakeProblem(views, 0, {1, 10});
  problem.sources.resize(static_cast<size_t>(sources), problem.sources[0]);
  return problem;
}

/// The definition: counts the users among the pixel and its four neighbours for each view.
uint32_t ReferenceCredibleViews(const KernelState& state, int col, int row) {
  const int num_sources = static_cast<int>(state.problem().sources.size());
  uint32_t credible = 0;
  for (int view = 0; view < num_sources; ++view) {
    int users = 0;
    for (const auto& [c, r] : {std::pair(col, row), {col - 1, row}, {col + 1, row}, {col, row - 1}, {col, row + 1}}) {
      if (c < 0 || r < 0 || c >= state.width() || r >= state.height()) continue;
      users += (state.selected_views(c, r) & (uint32_t{1} << view)) != 0 ? 1 : 0;
    }
    if (users >= state.options().min_neighbours_per_view) credible |= uint32_t{1} << view;
  }
  if (credible != 0) return credible;
  for (int view = 0; view < num_sources; ++view) credible |= uint32_t{1} << view;
  return credible;
}

TEST(CredibleViewsTest, AgreesWithTheReferenceAlsoAtTheBorder) {
  const std::vector<PlanarView> views = RandomViews(2, 6, 5, 2);
  TestRandom random(5);
  for (const int sources : {1, 2, 7, 31, 32}) {
    for (int users = 1; users <= 5; ++users) {
      PatchMatchOptions options;
      options.min_neighbours_per_view = users;
      KernelState state(ProblemWithSources(views, sources), options);
      int all = 0, some = 0;
      for (int round = 0; round < 60; ++round) {
        // From images where nearly no view is used to such where nearly all are.
        for (uint32_t& mask : state.selected_views) {
          mask = RandomMask(&random);
          if (round % 4 == 0) mask &= RandomMask(&random) & RandomMask(&random);
          if (round % 4 == 1) mask |= RandomMask(&random) | RandomMask(&random);
          mask &= AllViews(sources);
        }
        for (int row = 0; row < state.height(); ++row) {
          for (int col = 0; col < state.width(); ++col) {
            const uint32_t expected = ReferenceCredibleViews(state, col, row);
            ASSERT_EQ(ViewsOfNeighbours(state.Context(), col, row), expected)
                << sources << " sources, " << users << " users, pixel " << col << ", " << row;
            ++(expected == AllViews(sources) ? all : some);
          }
        }
      }
      EXPECT_GT(all, 0) << sources << " sources, " << users << " users";
      EXPECT_EQ(some > 0, sources > 1) << sources << " sources, " << users << " users";
    }
  }
}

TEST(DrawViewsTest, NeverDrawsAViewOfProbabilityZero) {
  TestRandom random(4);
  for (int i = 0; i < 300; ++i) {
    std::vector<float> probability(static_cast<size_t>(1 + random.Below(32)));
    double total = 0;
    for (float& p : probability) {
      // Magnitudes far apart provoke rounding at the ends of the intervals.
      p = random(0, 1) < 0.5 ? 0.0f : static_cast<float>(std::pow(10.0, random(-12, 3)));
      total += p;
    }
    for (uint32_t pixel = 0; pixel < 20; ++pixel) {
      RandomStream stream(1, pixel, 1);
      std::vector<int> draws(probability.size());
      const bool any =
          DrawViews(probability.data(), static_cast<int>(draws.size()), 255, SingleThread(), &stream, draws.data());
      EXPECT_EQ(any, total > 0);
      EXPECT_EQ(std::accumulate(draws.begin(), draws.end(), 0), any ? 255 : 0);
      for (size_t j = 0; j < draws.size(); ++j) EXPECT_TRUE(probability[j] > 0 || draws[j] == 0) << "view " << j;
    }
  }
}

}  // namespace
}  // namespace acmp
