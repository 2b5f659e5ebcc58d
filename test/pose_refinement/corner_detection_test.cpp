#include "matching.h"

#include <gtest/gtest.h>

#include <cmath>

namespace acmp {
namespace {

/// A smooth pattern without repetition nearby, moved.
GrayImage Pattern(const Eigen::Vector2d& shift) {
  GrayImage image(120, 100);
  for (int row = 0; row < image.height(); ++row) {
    for (int col = 0; col < image.width(); ++col) {
      const double x = col - 60 - shift.x(), y = row - 50 - shift.y();
      const double value = 110 + 40 * std::sin(0.31 * x + 0.2 * y) + 35 * std::cos(0.27 * y - 0.17 * x + 1) +
                           15 * std::sin(0.011 * x * y);
      image(col, row) = static_cast<float>(value);
    }
  }
  return image;
}

const Eigen::Vector2d kPixel(60, 50);

TEST(PatchAlignmentTest, FindsAShiftToAFractionOfAPixel) {
  const GrayPyramid image(Pattern({0, 0}).View());
  for (const Eigen::Vector2d& shift : {Eigen::Vector2d(0, 0), {0.3, -0.4}, {3.7, 2.2}, {-6.2, 4.5}}) {
    const GrayPyramid other(Pattern(shift).View());
    const Alignment found = Align(image, kPixel, Eigen::Matrix2d::Identity(), other, kPixel);
    ASSERT_TRUE(found.found) << shift.transpose();
    EXPECT_LT((found.pixel - kPixel - shift).norm(), 0.05) << shift.transpose();
  }
}

TEST(PatchAlignmentTest, WhatIsNotThereIsNotFound) {
  const GrayPyramid image(Pattern({0, 0}).View());
  const GrayPyramid blank(GrayImage(120, 100, 90.0f).View());
  EXPECT_FALSE(Align(image, kPixel, Eigen::Matrix2d::Identity(), blank, kPixel).found);
  EXPECT_FALSE(Align(blank, kPixel, Eigen::Matrix2d::Identity(), image, kPixel).found);
  EXPECT_FALSE(Align(image, kPixel, Eigen::Matrix2d::Identity(), image, {-50, 50}).found);
  EXPECT_FALSE(Align(image, {1, 1}, Eigen::Matrix2d::Identity(), image, kPixel).found);
  EXPECT_FALSE(Align(image, kPixel, Eigen::Matrix2d::Zero(), image, kPixel).found);
}

TEST(CornerDetectionTest, CornersOfASquareAreFoundAndTakenCellsLeftOut) {
  GrayImage square(120, 100, 60.0f);
  for (int row = 30; row < 70; ++row) {
    for (int col = 40; col < 80; ++col) square(col, row) = 180;
  }
  View view;
  view.pyramid = GrayPyramid(square.View());
  constexpr int kCells = 30;  // of 20 px
  const Image<float> response = CornerResponse(view);
  const std::vector<Eigen::Vector2d> corners = PickCorners(view, response, kCells);
  ASSERT_EQ(corners.size(), 4u);
  for (const Eigen::Vector2d& corner : corners) {
    EXPECT_LT(std::abs(std::abs(corner.x() - 59.5) - 20), 3);
    EXPECT_LT(std::abs(std::abs(corner.y() - 49.5) - 20), 3);
  }
  EXPECT_EQ(PickCorners(view, response, kCells, {corners[0]}).size(), 3u);

  Mask mask(120, 100, 255);
  mask(45, 35) = 0;  // near the corner at (40, 30)
  view.mask_distance = MakeMaskDistance(mask);
  EXPECT_EQ(PickCorners(view, response, kCells).size(), 3u);
}

}  // namespace
}  // namespace acmp
