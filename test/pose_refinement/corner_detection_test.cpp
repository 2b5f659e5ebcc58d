#include "matching.h"

#include <gtest/gtest.h>

#include <cmath>

namespace acmp {
namespace {

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
