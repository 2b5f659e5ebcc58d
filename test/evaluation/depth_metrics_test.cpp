#include "acmp_mapping/evaluation/depth_metrics.h"
#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"

namespace acmp {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

DepthMap Row(const std::vector<float>& values) {
  DepthMap map(static_cast<int>(values.size()), 1);
  std::copy(values.begin(), values.end(), map.begin());
  return map;
}

// Ground truth with holes and an estimate with errors of all sizes, holes and junk.
struct Pair {
  DepthMap estimate, truth;
};
Pair RandomPair(int width, int height, uint32_t seed) {
  Pair pair{DepthMap(width, height), DepthMap(width, height)};
  for (int i = 0; i < width * height; ++i) {
    RandomStream random(seed, static_cast<uint32_t>(i), 0);
    const float truth = random.NextUniform(0.5f, 6.0f);
    pair.truth.data()[i] = random.NextUniform() < 0.2f ? 0.0f : truth;
    const float wrong = random.NextUniform(-0.2f, 0.2f) * random.NextUniform();
    const float junk[] = {0.0f, -1.0f, kNan, kInf};
    const float draw = random.NextUniform();
    pair.estimate.data()[i] = draw < 0.2f ? junk[static_cast<int>(draw * 20)] : truth + wrong;
  }
  return pair;
}

// Straight from the definition, in double.
DepthMetrics Reference(const Pair& pair) {
  DepthMetrics metrics;
  std::vector<double> errors;
  for (size_t i = 0; i < pair.truth.size(); ++i) {
    const double truth = pair.truth.data()[i], estimate = pair.estimate.data()[i];
    if (!(truth > 0)) continue;
    ++metrics.ground_truth_pixels;
    if (!std::isfinite(estimate) || estimate <= 0) continue;
    const double error = std::abs(estimate - truth);
    errors.push_back(error);
    for (int k = 0; k < 3; ++k) {
      metrics.below_absolute[k] += error < kAbsoluteThresholds[k];
      metrics.below_relative[k] += error < kRelativeThresholds[k] * truth;
    }
  }
  for (int k = 0; k < 3; ++k) {
    metrics.below_absolute[k] *= 100.0 / metrics.ground_truth_pixels;
    metrics.below_relative[k] *= 100.0 / metrics.ground_truth_pixels;
  }
  metrics.density = 100.0 * errors.size() / metrics.ground_truth_pixels;
  std::sort(errors.begin(), errors.end());
  const size_t n = errors.size();
  metrics.median_error = n % 2 ? errors[n / 2] : (errors[n / 2 - 1] + errors[n / 2]) / 2;
  return metrics;
}

TEST(EvaluateDepth, AgreesWithAPlainDoublePrecisionReference) {
  for (const auto& [width, height] : {std::pair{64, 48}, std::pair{37, 23}, std::pair{1, 201}}) {
    const Pair pair = RandomPair(width, height, static_cast<uint32_t>(width));
    const DepthMetrics expected = Reference(pair);
    const DepthMetrics metrics = EvaluateDepth(pair.estimate, pair.truth);
    EXPECT_EQ(metrics.ground_truth_pixels, expected.ground_truth_pixels);
    for (int k = 0; k < 3; ++k) {
      // Errors are continuous: none lies within float rounding (5e-7) of a threshold for these seeds.
      EXPECT_NEAR(metrics.below_absolute[k], expected.below_absolute[k], 1e-9);
      EXPECT_NEAR(metrics.below_relative[k], expected.below_relative[k], 1e-9);
      EXPECT_GT(metrics.below_absolute[k], 0);
      EXPECT_LT(metrics.below_absolute[k], 100);
    }
    EXPECT_NEAR(metrics.density, expected.density, 1e-9);
    EXPECT_NEAR(metrics.median_error, expected.median_error, 1e-6);  // float rounding of depths below 8
  }
}

TEST(MedianScale, IsThatOfWhatIsKnownOnBothSides) {
  EXPECT_DOUBLE_EQ(MedianScale(Row({1, 2, 0, 4, 5}), Row({2, 4, 3, 0, 50})), 2);
  EXPECT_EQ(MedianScale(Row({0, kNan}), Row({1, 1})), 1);
  EXPECT_EQ(MedianScale(DepthMap(), Row({1, 1})), 1);
}

TEST(EvaluateDepth, IsUndefinedWithoutGroundTruth) {
  const DepthMetrics metrics = EvaluateDepth(Row({1.0f, 1.0f}), Row({0.0f, kNan}));
  EXPECT_EQ(metrics.ground_truth_pixels, 0u);
  EXPECT_TRUE(std::isnan(metrics.below_absolute[0]));
  EXPECT_TRUE(std::isnan(metrics.density));
}

TEST(EvaluateDepth, AnErrorOfExactlyTheThresholdIsNotBelowIt) {
  // 0.2f is twice 0.1f: their difference is the threshold to the last bit.
  EXPECT_EQ(EvaluateDepth(Row({0.2f}), Row({0.1f})).below_absolute[2], 0.0);
  EXPECT_EQ(EvaluateDepth(Row({std::nextafter(0.2f, 0.0f)}), Row({0.1f})).below_absolute[2], 100.0);
}

TEST(EvaluateDepth, LooksUpAnEstimateOfAnotherSizeAtTheNearestPixelCentre) {
  // Three times smaller: pixels 0..2 belong to 0, 3..5 to 1.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({1.0f, 2.0f}), Row({1, 1, 1, 2, 2, 2})).below_absolute[0], 100.0);
  // Three times larger: the middle one of each three.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({9, 1, 9, 9, 2, 9}), Row({1, 2})).below_absolute[0], 100.0);
  // Twice larger: centres lie half way, which goes to the even pixel: 0.5 -> 0, 2.5 -> 2.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({1, 9, 2, 9}), Row({1, 2})).below_absolute[0], 100.0);
  // Another aspect ratio: each axis by itself.
  DepthMap estimate(1, 2);
  estimate(0, 0) = 1;
  estimate(0, 1) = 2;
  DepthMap truth(2, 4, 1.0f);
  for (int row = 2; row < 4; ++row) truth(0, row) = truth(1, row) = 2;
  EXPECT_DOUBLE_EQ(EvaluateDepth(estimate, truth).below_absolute[0], 100.0);
}

TEST(EvaluateDepth, RestrictsToTheMask) {
  Image<unsigned char> mask(3, 1);
  mask(1, 0) = 255;
  const DepthMetrics metrics = EvaluateDepth(Row({1, 2, 3}), Row({9, 2, 9}), mask.View());
  EXPECT_EQ(metrics.ground_truth_pixels, 1u);
  EXPECT_DOUBLE_EQ(metrics.below_absolute[0], 100.0);
  const Image<unsigned char> wrong_size(2, 1);
  EXPECT_THROW(EvaluateDepth(Row({1, 2, 3}), Row({1, 2, 3}), wrong_size.View()), InvalidInputError);
}

TEST(MeanOfDepthMetrics, WeighsImagesEquallyAndLeavesOutThoseWithoutGroundTruth) {
  const DepthMetrics good = EvaluateDepth(Row({1, 1, 1}), Row({1, 1, 1}));
  const DepthMetrics missing = EvaluateDepth(DepthMap(), Row({1}));
  const DepthMetrics no_truth = EvaluateDepth(Row({1}), Row({0}));
  const DepthMetrics mean = Mean({good, missing, no_truth});
  EXPECT_EQ(mean.ground_truth_pixels, 2u);
  EXPECT_DOUBLE_EQ(mean.below_absolute[0], 50.0);
  EXPECT_DOUBLE_EQ(mean.density, 50.0);
  EXPECT_DOUBLE_EQ(mean.median_error, 0.0);  // of the only image that has one
  EXPECT_TRUE(std::isnan(Mean({no_truth}).density));
  EXPECT_TRUE(std::isnan(Mean({}).density));
}

}  // namespace
}  // namespace acmp
