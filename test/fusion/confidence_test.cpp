#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {
namespace {

TEST(ComputeConfidence, HasTheDocumentedValues) {
  // C = 0.2 P + 0.5 S + 0.3 P S, worked out by hand; float rounding is below 1e-7.
  EXPECT_NEAR(ComputeConfidence(0, 0, 0), 0.2, 1e-6);
  EXPECT_NEAR(ComputeConfidence(0, 2, 10), 0.2 + 0.5 * 0.75 + 0.3 * 0.75, 1e-6);
  EXPECT_NEAR(ComputeConfidence(0, 2, 5), 0.2 + 0.5 * 0.5 + 0.3 * 0.5, 1e-6);
  EXPECT_NEAR(ComputeConfidence(2, 1, 90), 0.25, 1e-6);
  EXPECT_NEAR(ComputeConfidence(0.3f, 0, 0), 0.2 * std::exp(-0.5), 1e-6);
}

TEST(ComputeConfidence, StaysInBoundsAndNeverGoesTheWrongWay) {
  for (int views = 0; views <= 32; ++views) {
    for (int cost = 0; cost <= 25; ++cost) {
      for (int angle = 0; angle <= 36; ++angle) {
        const float confidence = ComputeConfidence(0.1f * cost, views, 0.5f * angle);
        ASSERT_GE(confidence, 0);
        ASSERT_LE(confidence, 1);
        ASSERT_LE(ComputeConfidence(0.1f * cost + 0.1f, views, 0.5f * angle), confidence);
        ASSERT_GE(ComputeConfidence(0.1f * cost, views + 1, 0.5f * angle), confidence);
        ASSERT_GE(ComputeConfidence(0.1f * cost, views, 0.5f * angle + 0.5f), confidence);
      }
    }
  }
  // And strictly the right way where it matters.
  EXPECT_GT(ComputeConfidence(0.1f, 2, 8), ComputeConfidence(0.2f, 2, 8));
  EXPECT_GT(ComputeConfidence(0.1f, 3, 8), ComputeConfidence(0.1f, 2, 8));
  EXPECT_GT(ComputeConfidence(0.1f, 2, 9), ComputeConfidence(0.1f, 2, 8));
  EXPECT_EQ(ComputeConfidence(0.1f, 2, 11), ComputeConfidence(0.1f, 2, 10));
}

TEST(ComputeConfidence, IsFiniteForOddInput) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  EXPECT_EQ(ComputeConfidence(nan, 0, 0), 0);
  EXPECT_EQ(ComputeConfidence(infinity, 0, 0), 0);
  EXPECT_FLOAT_EQ(ComputeConfidence(-0.5f, 0, 0), 0.2f);
  EXPECT_FLOAT_EQ(ComputeConfidence(0, 3, nan), 0.2f);
  EXPECT_FLOAT_EQ(ComputeConfidence(0, -1, 10), 0.2f);
}

}  // namespace
}  // namespace acmp
