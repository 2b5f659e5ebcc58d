#include "acmp_mapping/patch_match/kernel/view_weights.h"

#include <cmath>
#include <numeric>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "support/random_views.h"

namespace acmp {
namespace {

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

TEST(PerturbNormalTest, NormalsAreNeverTurnedAwayFromTheCamera) {
  // A nearly edge-on normal: half of the turns would leave the half sphere.
  const Vec3f ray = {0, 0, 1}, normal = {0.9999f, 0, -std::sqrt(1 - 0.9999f * 0.9999f)};
  int kept = 0;
  for (uint32_t pixel = 0; pixel < 2000; ++pixel) {
    RandomStream random(5, pixel, 0);
    const Vec3f turned = PerturbNormal(normal, ray, 0.1f, &random);
    ASSERT_LT(Dot(turned, ray), 0);
    kept += turned.x == normal.x && turned.y == normal.y && turned.z == normal.z ? 1 : 0;
  }
  EXPECT_GT(kept, 200);
  EXPECT_LT(kept, 1800);
}

}  // namespace
}  // namespace acmp
