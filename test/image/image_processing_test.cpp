#include "acmp_mapping/image/image_processing.h"

#include <cmath>

#include <opencv2/core.hpp>

#include "gtest/gtest.h"

namespace acmp {
namespace {

TEST(ToGrayTest, UsesTheLumaWeights) {
  ColorImage color(5, 1);
  color(0, 0) = {255, 0, 0};
  color(1, 0) = {0, 255, 0};
  color(2, 0) = {0, 0, 255};
  color(3, 0) = {255, 255, 255};
  color(4, 0) = {10, 20, 200};
  const GrayImage gray = ToGray(color);
  // ITU-R BT.601, in float: not rounded to whole grey levels.
  const auto luma = [](double r, double g, double b) { return 0.299 * r + 0.587 * g + 0.114 * b; };
  EXPECT_NEAR(gray(0, 0), luma(255, 0, 0), 1e-3);  // OpenCV's weights have three digits; float rounding of 255
  EXPECT_NEAR(gray(1, 0), luma(0, 255, 0), 1e-3);
  EXPECT_NEAR(gray(2, 0), luma(0, 0, 255), 1e-3);
  EXPECT_NEAR(gray(3, 0), 255, 1e-3);
  EXPECT_NEAR(gray(4, 0), luma(10, 20, 200), 1e-3);
}

/// 2 col + 3 row: linear, so any filter with the right pixel centres reproduces it.
GrayImage Ramp(int width, int height) {
  GrayImage ramp(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col)
      ramp(col, row) = 2.0f * static_cast<float>(col) + 3.0f * static_cast<float>(row);
  }
  return ramp;
}

/// Position in the original image of pixel u of the result: (u + 0.5) / s - 0.5.
double Original(int u, int new_size, int old_size) {
  return (u + 0.5) * static_cast<double>(old_size) / new_size - 0.5;
}

double ExpectedRamp(int col, int row, const GrayImage& resized, const GrayImage& ramp) {
  return 2.0 * Original(col, resized.width(), ramp.width()) + 3.0 * Original(row, resized.height(), ramp.height());
}

TEST(ResizeTest, ShrinkingByWholeFactorsKeepsALinearRamp) {
  const GrayImage ramp = Ramp(60, 24);
  for (const auto& [width, height] : {std::pair(30, 12), {20, 8}, {60, 24}, {60, 8}, {10, 2}}) {
    const GrayImage resized = Resize(ramp, width, height);
    ASSERT_EQ(resized.width(), width);
    ASSERT_EQ(resized.height(), height);
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        // Whole pixels are averaged: exact but for float sums of values up to 190.
        ASSERT_NEAR(resized(col, row), ExpectedRamp(col, row, resized, ramp), 1e-3) << col << ", " << row;
      }
    }
  }
}

TEST(ResizeTest, EnlargingIsBilinearWithClampedBorders) {
  const GrayImage ramp = Ramp(9, 7);
  const GrayImage resized = Resize(ramp, 30, 25);
  for (int row = 0; row < 25; ++row) {
    for (int col = 0; col < 30; ++col) {
      const double x = std::clamp(Original(col, 30, 9), 0.0, 8.0);
      const double y = std::clamp(Original(row, 25, 7), 0.0, 6.0);
      ASSERT_NEAR(resized(col, row), 2 * x + 3 * y, 1e-4) << col << ", " << row;
    }
  }
}

TEST(ResizeTest, ColourIsResizedLikeGrey) {
  ColorImage color(40, 30);
  for (int row = 0; row < 30; ++row) {
    for (int col = 0; col < 40; ++col) {
      color(col, row) = {static_cast<unsigned char>(4 * col), static_cast<unsigned char>(4 * row), 77};
    }
  }
  const ColorImage resized = Resize(color, 20, 10);
  for (int row = 0; row < 10; ++row) {
    for (int col = 0; col < 20; ++col) {
      EXPECT_NEAR(resized(col, row).r, 4 * Original(col, 20, 40), 0.51);  // rounded to 8 bits
      EXPECT_NEAR(resized(col, row).g, 4 * Original(row, 10, 30), 0.51);
      EXPECT_EQ(resized(col, row).b, 77);
    }
  }
}

}  // namespace
}  // namespace acmp
