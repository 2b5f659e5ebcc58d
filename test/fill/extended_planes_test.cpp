#include <cmath>
#include <set>
#include <utility>

#include "fill/fill_kernel_fixture.h"

namespace acmp {
namespace {

TEST_F(FillKernelTest, DirectionsGoRoundTheCompass) {
  std::set<std::pair<int, int>> steps;
  int sum_c = 0, sum_r = 0;
  for (int direction = 0; direction < kNumDirections; ++direction) {
    int dc, dr;
    DirectionStep(direction, &dc, &dr);
    steps.insert({dc, dr});
    sum_c += dc;
    sum_r += dr;
  }
  EXPECT_EQ(steps.size(), 16u);
  EXPECT_EQ(steps.count({0, 0}), 0u);
  EXPECT_EQ(sum_c, 0);
  EXPECT_EQ(sum_r, 0);
}

TEST_F(FillKernelTest, NearestSeedsAreTheFirstOnesOfEachDirection) {
  // Directions 0, 4, 8, 12 go right, down, left, up; 2 and 1 one and two cells right for each cell down.
  for (const auto& [col, row] : {std::pair(7, 2), {8, 2}, {3, 6}, {5, 4}, {7, 4}}) fitted_(col, row).views = 3;
  FindAllNearest();
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const NearestSeeds& nearest = nearest_(3, 2);
  EXPECT_EQ(nearest.cell[0], cell(7, 2));
  EXPECT_EQ(nearest.cell[4], cell(3, 6));
  EXPECT_EQ(nearest.cell[8], -1);
  EXPECT_EQ(nearest.cell[12], -1);
  EXPECT_EQ(nearest.cell[2], cell(5, 4));
  EXPECT_EQ(nearest.cell[1], cell(7, 4));
  for (const int own : nearest_(7, 4).cell) EXPECT_EQ(own, cell(7, 4));
}

TEST_F(FillKernelTest, AStrongSeedGoesBeforeANearerOneUpToEightTimesAsFarAndTwoCells) {
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const auto set = [&](int col, int row, bool is_strong) {
    fitted_(col, row).views = 3;
    fitted_(col, row).is_strong = is_strong;
  };
  // To the right of (0, row): a seed and a strong one.
  set(0, 0, false), set(2, 0, true);
  set(0, 1, false), set(3, 1, true);
  set(1, 2, false), set(2, 2, false), set(9, 2, true);
  set(1, 3, true), set(2, 3, true);
  set(4, 4, false);
  context_.strong_views = 4;
  FindAllNearest();
  EXPECT_EQ(nearest_(0, 0).cell[0], cell(2, 0));
  EXPECT_EQ(nearest_(0, 1).cell[0], cell(0, 1)) << "three steps instead of none";
  EXPECT_EQ(nearest_(0, 2).cell[0], cell(9, 2)) << "nine steps instead of one";
  EXPECT_EQ(nearest_(0, 3).cell[0], cell(1, 3)) << "the first of the sure ones";
  EXPECT_EQ(nearest_(0, 4).cell[0], cell(4, 4)) << "there is no other";
  EXPECT_EQ(nearest_(0, 5).cell[0], -1);
  context_.strong_views = 0;
  FindAllNearest();
  for (const auto& [row, col] : {std::pair(0, 0), {1, 0}, {2, 1}, {3, 1}, {4, 4}}) {
    EXPECT_EQ(nearest_(0, row).cell[0], cell(col, row)) << "the first one";
  }
}

TEST_F(FillKernelTest, WhatEnoughViewsConfirmCloselyIsTheSeedOfItsCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  support_(8, 4) = PackViewSupport(9, 2, true, 0);
  support_(9, 4) = PackViewSupport(3, 3, true, 0);
  support_(16, 4) = PackViewSupport(4, 2, true, 0);
  context_.strong_views = 3;
  FindAll();
  EXPECT_TRUE(seeds_(2, 1).is_strong);
  EXPECT_EQ(seeds_(2, 1).col, 9) << "before one with nine views";
  EXPECT_EQ(seeds_(2, 1).views, 3);
  EXPECT_FALSE(seeds_(4, 1).is_strong);
  EXPECT_EQ(seeds_(4, 1).views, 4);
  FitAll();
  EXPECT_TRUE(fitted_(2, 1).is_strong);
  EXPECT_FALSE(fitted_(4, 1).is_strong);
  context_.strong_views = 0;
  FindAll();
  EXPECT_FALSE(seeds_(2, 1).is_strong);
  EXPECT_EQ(seeds_(2, 1).views, 9);
}

/// Fronto-parallel seeds at some distance from the pixel (0, 0), in the directions that a test names.
class ExtendedPlanesTest : public FillKernelTest {
 protected:
  ExtendedPlanesTest() {
    for (int& cell : nearest_(0, 0).cell) cell = -1;
  }
  void SetSeed(int direction, int cell, int distance_cells, float inverse_depth) {
    nearest_(0, 0).cell[direction] = cell;
    // Of a right triangle with sides 3, 4 and 5.
    const int px = distance_cells * kCell;
    fitted_.data()[cell] = {2, 3 * px / 5, 4 * px / 5, inverse_depth, {0, 0, inverse_depth}};
  }
  ExtendedPlanes Find() {
    ExtendedPlanes planes;
    FindExtendedPlanes(context_, nearest_(0, 0), 0, 0, &planes);
    return planes;
  }
};

TEST_F(ExtendedPlanesTest, NearerSeedsCountMore) {
  // One near seed against three that are 20 cells farther: each of those weighs exp(-20 / 9) = 0.11.
  SetSeed(0, 11, 25, 0.1f), SetSeed(4, 12, 25, 0.2f), SetSeed(8, 13, 25, 0.3f), SetSeed(12, 14, 5, 0.4f);
  const ExtendedPlanes planes = Find();
  EXPECT_NEAR(planes.weight[0], std::exp(-20 / 9.0), 1e-6);
  EXPECT_EQ(planes.weight[12], 1);
  EXPECT_EQ(planes.weight[1], 0);
  EXPECT_EQ(planes.inverse_depth[8], 0.3f);
  EXPECT_EQ(WeightedQuantile(planes, 0.5f), 12);
}

TEST_F(ExtendedPlanesTest, OfEqualWeightsTheOneInTheMiddleIsTheMedian) {
  SetSeed(0, 11, 5, 0.3f), SetSeed(4, 12, 5, 0.1f), SetSeed(8, 13, 5, 0.2f);
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 8);
  nearest_(0, 0).cell[0] = -1;  // of two the first
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 4);
  nearest_(0, 0).cell[4] = -1;
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 8);
  SetSeed(8, 13, 5, 1 / 0.9f);  // nearer than the depth range
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), -1);
}

TEST_F(ExtendedPlanesTest, SharesCountFromTheFarthest) {
  SetSeed(0, 11, 5, 0.3f), SetSeed(4, 12, 5, 0.1f), SetSeed(8, 13, 5, 0.2f), SetSeed(12, 14, 5, 0.4f);
  for (const auto& [share, direction] : {std::pair(0.0f, 4), {0.2f, 4}, {0.3f, 8}, {0.7f, 0}, {0.8f, 12}, {1.0f, 12}}) {
    EXPECT_EQ(WeightedQuantile(Find(), share), direction) << share;
  }
}

TEST_F(ExtendedPlanesTest, AlternativesTakeTurnsByBlocks) {
  SetSeed(0, 11, 5, 0.3f), SetSeed(4, 12, 5, 0.1f), SetSeed(8, 13, 5, 0.2f);
  context_.near_and_far = false;
  EXPECT_EQ(DepthQuantile(context_, 0, 0), 0.5f);
  EXPECT_EQ(DepthQuantile(context_, 2, 0), 0.5f);
  context_.near_and_far = true;
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col) {
      const int direction = WeightedQuantile(Find(), DepthQuantile(context_, col, row));
      EXPECT_EQ(direction, (col / 2 + row / 2) % 2 == 0 ? 8 : 4) << "the middle one or the farthest";
    }
  }
}

}  // namespace
}  // namespace acmp
