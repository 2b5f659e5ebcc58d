#include "acmp_mapping/patch_match/kernel/view_weights.h"

#include <algorithm>
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

TEST(ViewSmoothnessTest, AddsEtaPerNeighbourThatUsesTheView) {
  const std::vector<PlanarView> views = RandomViews(2, 5, 4, 2);
  PatchMatchOptions options;
  options.view_smoothness = 0.8f;
  KernelState state(MakeProblem(views, 0, {1, 10}), options);
  TestRandom random(3);
  for (uint32_t& mask : state.selected_views) {
    mask = static_cast<uint32_t>(random.Below(65536)) << 16 | static_cast<uint32_t>(random.Below(65536));
  }
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 5; ++col) {
      for (const int view : {0, 1, 15, 31}) {
        double expected = 0;
        for (const auto& [c, r] : {std::pair(col - 1, row), {col + 1, row}, {col, row - 1}, {col, row + 1}}) {
          if (c < 0 || r < 0 || c >= 5 || r >= 4) continue;
          expected += (state.selected_views(c, r) & (uint32_t{1} << view)) != 0 ? 0.8 : 0.2;
        }
        EXPECT_NEAR(ViewSmoothness(state.Context(), col, row, view), expected, 1e-6);
      }
    }
  }
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

TEST(ListViewsTest, ListsTheBitsFromTheLowest) {
  TestRandom random(6);
  for (int views = 1; views <= kMaxSourceViews; ++views) {
    for (int round = 0; round < 200; ++round) {
      uint32_t mask = RandomMask(&random);
      if (round % 3 == 1) mask &= RandomMask(&random) & RandomMask(&random);
      mask &= AllViews(views);
      if (round == 0) mask = 0;
      if (round == 1) mask = AllViews(views);
      if (round == 2) mask = uint32_t{1} << (views - 1);
      std::vector<int> expected;
      for (int j = 0; j < views; ++j) {
        if ((mask & (uint32_t{1} << j)) != 0) expected.push_back(j);
      }
      std::vector<int> list(kMaxSourceViews + 1, -1);
      const int count = ListViews(mask, views, SingleThread(), list.data());
      ASSERT_EQ(count, static_cast<int>(expected.size())) << "mask " << mask;
      expected.resize(list.size(), -1);  // the rest is not written
      ASSERT_EQ(list, expected) << "mask " << mask;
    }
  }
}

struct DrawnViews {
  int draws[kMaxSourceViews] = {};
  int sum = 0;
  uint32_t mask = 0;
};

/// Draws alone, with the list of drawn views checked against the counts.
DrawnViews Draw(const float* probability, int views, int draws, RandomStream* random) {
  DrawnViews drawn;
  const bool any = DrawViews(probability, views, draws, SingleThread(), random, drawn.draws);
  drawn.sum = std::accumulate(drawn.draws, drawn.draws + kMaxSourceViews, 0);
  EXPECT_EQ(any, drawn.sum > 0);
  int list[kMaxSourceViews];
  drawn.mask = ListWeighedViews(drawn.draws, views, SingleThread(), list);
  std::vector<int> expected;
  for (int j = 0; j < views; ++j) {
    if (drawn.draws[j] > 0) expected.push_back(j);
  }
  std::stable_sort(expected.begin(), expected.end(), [&](int a, int b) { return drawn.draws[a] > drawn.draws[b]; });
  EXPECT_EQ(std::vector<int>(list, list + CountBits(drawn.mask)), expected);
  return drawn;
}

/// Draws for many pixels: totals per view, with the bookkeeping checked on the way.
std::vector<double> DrawMany(const std::vector<float>& probability, int draws, int pixels) {
  const int views = static_cast<int>(probability.size());
  std::vector<double> totals(probability.size());
  for (int pixel = 0; pixel < pixels; ++pixel) {
    RandomStream random(1, static_cast<uint32_t>(pixel), 1);
    const DrawnViews weights = Draw(probability.data(), views, draws, &random);
    int sum = 0;
    for (int j = 0; j < views; ++j) {
      sum += weights.draws[j];
      totals[j] += weights.draws[j];
      EXPECT_EQ((weights.mask & (uint32_t{1} << j)) != 0, weights.draws[j] > 0);
    }
    EXPECT_EQ(weights.sum, sum);
    EXPECT_EQ(uint64_t{weights.mask} >> views, 0u);
  }
  return totals;
}

TEST(DrawViewsTest, FrequenciesFollowTheProbabilities) {
  for (const std::vector<float>& probability : {std::vector<float>{1, 1},
                                                {0.1f, 0.2f, 0.3f, 0.4f},
                                                {5, 0, 1, 0, 2},
                                                {0, 0, 3, 1, 0},
                                                {1e-3f, 1.0f, 1e-3f},
                                                {1e-20f, 3e-20f},
                                                {2e4f, 1e4f, 1e4f}}) {
    constexpr int kPixels = 20000, kDraws = 15;
    const std::vector<double> totals = DrawMany(probability, kDraws, kPixels);
    const double norm = std::accumulate(probability.begin(), probability.end(), 0.0);
    for (size_t j = 0; j < probability.size(); ++j) {
      const double p = probability[j] / norm;
      const double mean = p * kPixels * kDraws;
      const double sigma = std::sqrt(mean * (1 - p));
      EXPECT_NEAR(totals[j], mean, 5 * sigma) << "view " << j;  // binomial: by chance less than once in a million
    }
  }
}

TEST(DrawViewsTest, NeverDrawsAViewOfProbabilityZero) {
  TestRandom random(4);
  for (int i = 0; i < 300; ++i) {
    std::vector<float> probability(1 + random.Below(32));
    double total = 0;
    for (float& p : probability) {
      // Magnitudes far apart provoke rounding at the ends of the intervals.
      p = random(0, 1) < 0.5 ? 0.0f : static_cast<float>(std::pow(10.0, random(-12, 3)));
      total += p;
    }
    const std::vector<double> totals = DrawMany(probability, 255, 20);
    for (size_t j = 0; j < probability.size(); ++j) {
      EXPECT_TRUE(probability[j] > 0 || totals[j] == 0) << "view " << j << " of " << probability.size();
    }
    EXPECT_EQ(std::accumulate(totals.begin(), totals.end(), 0.0), total > 0 ? 255 * 20 : 0);
  }
}

// Members of a group draw every kSize-th number: the stream goes on behind all of them, whoever drew which.
TEST(DrawViewsTest, TakesAsManyNumbersAsDraws) {
  RandomStream random(1, 2, 3), other(1, 2, 3);
  const float probability[2] = {0.5f, 0.5f};
  Draw(probability, 2, 15, &random);
  for (int i = 0; i < 15; ++i) other.NextWord();
  EXPECT_EQ(random.NextWord(), other.NextWord());
}

TEST(DrawViewsTest, AllZeroDrawsNothing) {
  for (const int views : {1, 2, 31, 32}) {
    const std::vector<float> probability(views, 0.0f);
    RandomStream random(1, 2, 3);
    const DrawnViews weights = Draw(probability.data(), views, 15, &random);
    EXPECT_EQ(weights.sum, 0);
    EXPECT_EQ(weights.mask, 0u);
    for (int j = 0; j < views; ++j) EXPECT_EQ(weights.draws[j], 0);
  }
}

TEST(DrawViewsTest, ThirtyTwoViewsUseTheWholeMask) {
  const std::vector<float> equal(32, 0.25f);
  const std::vector<double> totals = DrawMany(equal, 15, 5000);
  const double mean = 15 * 5000 / 32.0;
  for (int j = 0; j < 32; ++j) EXPECT_NEAR(totals[j], mean, 5 * std::sqrt(mean)) << "view " << j;
  std::vector<float> last(32, 0.0f);
  last[31] = 1e-30f;
  RandomStream random(1, 2, 3);
  const DrawnViews weights = Draw(last.data(), 32, 15, &random);
  EXPECT_EQ(weights.draws[31], 15);
  EXPECT_EQ(weights.mask, 0x80000000u);
}

}  // namespace
}  // namespace acmp
