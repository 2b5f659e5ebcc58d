#include "acmp_mapping/image/sharpening.h"

#include <cmath>
#include <limits>

#include <opencv2/core.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

constexpr int kWidth = 200, kHeight = 150;

/// Mid grey that rises slowly, with white noise.
GrayImage NoisyRamp(double noise, unsigned seed = 3) {
  GrayImage gray(kWidth, kHeight);
  cv::RNG random(seed);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      gray(col, row) = static_cast<float>(100 + 0.1 * col + 0.2 * row + random.gaussian(noise));
    }
  }
  return gray;
}

void AddTexture(int first_col, int end_col, double amplitude, GrayImage* gray) {
  for (int row = 0; row < gray->height(); ++row) {
    for (int col = first_col; col < end_col; ++col) {
      (*gray)(col, row) += static_cast<float>(amplitude * std::sin(1.9 * col) * std::cos(1.7 * row));
    }
  }
}

/// Standard deviation of the image minus the ramp, at least 5 px from the border.
double DeviationFromRamp(const GrayImage& gray, int first_col = 5, int end_col = kWidth - 5) {
  double sum = 0;
  int count = 0;
  for (int row = 5; row < kHeight - 5; ++row) {
    for (int col = first_col; col < end_col; ++col, ++count) {
      const double off = gray(col, row) - (100 + 0.1 * col + 0.2 * row);
      sum += off * off;
    }
  }
  return std::sqrt(sum / count);
}

TEST(EstimateNoiseTest, FindsWhiteNoise) {
  // The means over blocks vary by a fifth, as differences share pixels: their lower quartile is 0.67 of that below.
  for (const double noise : {0.5, 2.0, 8.0}) {
    EXPECT_LT(EstimateNoise(NoisyRamp(noise)), noise) << noise;
    EXPECT_GT(EstimateNoise(NoisyRamp(noise)), 0.8 * noise) << noise;
  }
}

TEST(EstimateNoiseTest, SmoothImagesHaveThatOfRounding) {
  EXPECT_NEAR(EstimateNoise(NoisyRamp(0)), 0.193, 1e-3);
  EXPECT_NEAR(EstimateNoise(GrayImage(9, 9)), 0.193, 1e-3);  // no block
  EXPECT_NEAR(EstimateNoise(GrayImage()), 0.193, 1e-3);
}

TEST(EstimateNoiseTest, IgnoresTexture) {
  GrayImage gray = NoisyRamp(2.0);
  AddTexture(0, kWidth * 2 / 3, 60, &gray);
  // The quartile of all is the upper quartile of the third without texture, as far above its mean.
  EXPECT_GT(EstimateNoise(gray), 2.0);
  EXPECT_LT(EstimateNoise(gray), 1.2 * 2.0);
}

TEST(EstimateNoiseTest, WhatIsCutOffDoesNotCount) {
  GrayImage gray = NoisyRamp(2.0);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth / 2; ++col) gray(col, row) = row % 2 == 0 ? 0.0f : 255.0f;
  }
  EXPECT_NEAR(EstimateNoise(gray), EstimateNoise(NoisyRamp(2.0)), 0.05 * 2.0);  // half as many blocks
}

TEST(SharpenTest, LeavesTheImageAloneAtGainZero) {
  GrayImage gray = NoisyRamp(2.0);
  const GrayImage before = gray.Clone();
  Sharpen(0, &gray);
  for (size_t i = 0; i < gray.size(); ++i) ASSERT_EQ(gray.data()[i], before.data()[i]);
}

TEST(SharpenTest, ReducesWhiteNoise) {
  GrayImage gray = NoisyRamp(4.0);
  Sharpen(3.0, &gray);
  // The blur alone leaves sqrt(sum of its squared weights) = 0.40 of it; the local mean square of 25 px exceeds twice
  // its expectation seldom, so that hardly any of the rest comes back.
  EXPECT_LT(DeviationFromRamp(gray), 0.45 * 4.0);
  EXPECT_GT(DeviationFromRamp(gray), 0.35 * 4.0);
}

TEST(SharpenTest, RaisesFaintDetailAboveTheNoise) {
  const auto sharpened = [](double gain) {
    GrayImage gray = NoisyRamp(0.0);
    AddTexture(0, kWidth / 2, 4, &gray);
    Sharpen(gain, &gray);
    return DeviationFromRamp(gray, 5, kWidth / 2 - 5);
  };
  const double one = sharpened(1), two = sharpened(2), three = sharpened(3);
  // 2: the texture's own standard deviation. Noise of 0.19 is a hundredth of its power: gain 1 leaves it nearly as it
  // is, and more of it is linear.
  EXPECT_NEAR(one, 2.0, 0.1);
  EXPECT_GT(two, 1.5 * one);
  EXPECT_NEAR(three - two, two - one, 0.02 * one);
}

TEST(SharpenTest, DecidesLocally) {
  GrayImage gray = NoisyRamp(2.0);
  AddTexture(0, 40, 10, &gray);
  const double before = DeviationFromRamp(gray, 5, 35);
  Sharpen(3.0, &gray);
  EXPECT_GT(DeviationFromRamp(gray, 5, 35), 1.2 * before);
  EXPECT_LT(DeviationFromRamp(gray, 45, kWidth - 5), 0.5 * 2.0);
}

TEST(SharpenTest, HardlyOvershootsBesideAStrongEdge) {
  GrayImage gray(40, 30);
  for (int row = 0; row < 30; ++row) {
    for (int col = 0; col < 40; ++col) gray(col, row) = col < 20 ? 55.0f : 200.0f;
  }
  const GrayImage before = gray.Clone();
  Sharpen(5.0, &gray);
  // The blur moves the pixels beside the edge by 0.21 of the step, 30; they and the two columns next to them have a
  // mean square of 370, so that 4 * 16 / (16 + 370) of that is added.
  EXPECT_NEAR(gray(19, 15), 55 - 5, 1);
  EXPECT_NEAR(gray(20, 15), 200 + 5, 1);
  for (int col = 0; col < 40; ++col) {
    if (col >= 18 && col <= 21) continue;
    EXPECT_NEAR(gray(col, 15), before(col, 15), 1) << col;
  }
}

TEST(SharpenTest, StaysWithinBlackAndWhite) {
  for (const float middle : {1.0f, 254.0f}) {
    GrayImage gray(40, 30);
    for (int row = 0; row < 30; ++row) {
      for (int col = 0; col < 40; ++col) gray(col, row) = middle + (col % 2 == 0 ? 1.0f : -1.0f);
    }
    Sharpen(10.0, &gray);  // by some 8 grey levels to both sides
    const float low = gray(21, 15), high = gray(20, 15);
    if (middle < 128) {
      EXPECT_EQ(low, 0.0f);
      EXPECT_GT(high, 5.0f);
    } else {
      EXPECT_EQ(high, 255.0f);
      EXPECT_LT(low, 250.0f);
    }
  }
}

// Strips of the image are filtered one by one: rows must not depend on where a strip begins.
TEST(SharpenTest, ShiftsWithTheImage) {
  constexpr int kShift = 13;
  GrayImage tall = NoisyRamp(0.0);  // half of it smooth: both have the noise of rounding
  AddTexture(0, kWidth / 2, 5, &tall);
  GrayImage lower(kWidth, kHeight - kShift);
  for (int row = 0; row < lower.height(); ++row) {
    for (int col = 0; col < kWidth; ++col) lower(col, row) = tall(col, row + kShift);
  }
  Sharpen(3.0, &tall);
  Sharpen(3.0, &lower);
  for (int row = 8; row < lower.height(); ++row) {  // its first rows have other rows above them
    for (int col = 0; col < kWidth; ++col) {
      ASSERT_NEAR(lower(col, row), tall(col, row + kShift), 1e-3) << col << ", " << row;
    }
  }
}

TEST(SharpenTest, TakesImagesOfAnySize) {
  for (const int width : {1, 2, 3, 7}) {
    for (const int height : {1, 2, 3, 33}) {
      GrayImage gray(width, height, 17.0f);
      Sharpen(2.0, &gray);
      for (size_t i = 0; i < gray.size(); ++i) ASSERT_NEAR(gray.data()[i], 17.0f, 1e-4) << width << " x " << height;
    }
  }
  GrayImage none;
  Sharpen(2.0, &none);
  EXPECT_EQ(none.size(), 0u);
}

TEST(SharpenTest, RefusesGainsOutOfBounds) {
  GrayImage gray(4, 4);
  EXPECT_THROW(Sharpen(-0.1, &gray), InvalidInputError);
  EXPECT_THROW(Sharpen(10.1, &gray), InvalidInputError);
  EXPECT_THROW(Sharpen(std::numeric_limits<double>::quiet_NaN(), &gray), InvalidInputError);
}

}  // namespace
}  // namespace acmp
