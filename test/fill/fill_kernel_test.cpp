#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/fit_seed.h"

namespace acmp {
namespace {

/// Maps and seeds of an image in cells of 4 px.
class FillKernelTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 30, kCell = 4;

  FillKernelTest() {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.seed_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.support = support_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.seeds = seeds_.View();
    context_.fitted = fitted_.View();
    context_.nearest = nearest_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }
  void FindAll() {
    for (int row = 0; row < seeds_.height(); ++row) {
      for (int col = 0; col < seeds_.width(); ++col) FindSeed(context_, col, row, SingleThread());
    }
  }
  void FindAllNearest() {
    for (int row = 0; row < nearest_.height(); ++row) {
      for (int col = 0; col < nearest_.width(); ++col) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestSeed(context_, col, row, i);
      }
    }
  }

  Image<ViewSupport> support_{kWidth, kHeight};
  PlaneMap planes_{kWidth, kHeight};
  CostMap cost_{kWidth, kHeight};
  Image<SeedCell> seeds_{CellsOf(kWidth, kCell), CellsOf(kHeight, kCell)}, fitted_{seeds_.width(), seeds_.height()};
  Image<NearestSeeds> nearest_{seeds_.width(), seeds_.height()};
  FillContext context_ = {};
};

TEST_F(FillKernelTest, SeedIsTheMostConfirmedPixelOfTheCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  const auto set = [&](int col, int row, int views, float cost) {
    support_(col, row) = static_cast<ViewSupport>(views);
    cost_(col, row) = cost;
  };
  set(5, 4, 1, 0.01f);                                           // too few
  set(9, 5, 2, 0.3f), set(10, 5, 2, 0.2f), set(11, 5, 2, 0.2f);  // the least cost, the first of two
  set(13, 5, 2, 0.1f), set(14, 6, 3, 0.9f);                      // views count more than cost
  set(39, 29, 4, 0.5f);                                          // in the last, cut-off cell
  planes_(10, 5) = {0, 0, -1, 8};
  FindAll();
  EXPECT_EQ(seeds_(1, 1).views, 0);
  EXPECT_EQ(seeds_(2, 1).col, 10);
  EXPECT_EQ(seeds_(2, 1).row, 5);
  EXPECT_FLOAT_EQ(seeds_(2, 1).inverse_depth, 1 / 8.0f);
  EXPECT_EQ(seeds_(3, 1).views, 3);
  EXPECT_EQ(seeds_(3, 1).col, 14);
  EXPECT_EQ(seeds_(9, 7).col, 39);
  EXPECT_EQ(seeds_(9, 7).row, 29);
}

TEST_F(FillKernelTest, FitFindsThePlaneOfTheSurroundingsDespiteABadNormalAndOutliers) {
  const PlaneHypothesis wall = PlaneThrough(Normalized(Vec3f{0.5f, 0.1f, -1}), Ray(20, 15), 4);
  const PlaneHypothesis front = {0, 0, -1, 2.5f};
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      const PlaneHypothesis& surface = col > 27 ? front : wall;
      // The right depth with a normal that faces the camera: 25 degrees off.
      planes_(col, row) = PlaneThrough({0, 0, -1}, Ray(col, row), DepthAt(surface, col, row));
      support_(col, row) = 3;
    }
  }
  FindAll();
  for (int row = 0; row < seeds_.height(); ++row) {
    for (int col = 0; col < seeds_.width(); ++col) FitSeed(context_, col, row, SingleThread());
  }
  const PlaneHypothesis fitted = PlaneOfInverse(fitted_(3, 3).inverse_plane);
  // The front plane is off by 60 % of its depth, far beyond the tolerance of 3 %: exact but for rounding and the ridge.
  EXPECT_NEAR(DepthAt(fitted, 13, 13), DepthAt(wall, 13, 13), 2e-3);
  EXPECT_NEAR(DepthAt(fitted, 27, 2), DepthAt(wall, 27, 2), 5e-3);
  EXPECT_GT(Dot(fitted.normal(), wall.normal()), 0.9999f);
  EXPECT_EQ(fitted_(3, 3).col, seeds_(3, 3).col);
}

TEST_F(FillKernelTest, ACloselyConfirmedSeedGoesBeforeANearerOneUpToEightTimesAsFarAndTwoCells) {
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const auto set = [&](int col, int row, bool is_strong) {
    fitted_(col, row).views = 3;
    fitted_(col, row).is_strong = is_strong;
  };
  // To the right of (0, row): a seed and a closely confirmed one.
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
  context_.strong_views = 0;
  FindAll();
  EXPECT_FALSE(seeds_(2, 1).is_strong);
  EXPECT_EQ(seeds_(2, 1).views, 9);
}

TEST_F(FillKernelTest, AlternativesTakeTurnsByBlocks) {
  // Fronto-parallel seeds as far from the pixel (0, 0) as each other.
  for (int& cell : nearest_(0, 0).cell) cell = -1;
  for (const auto& [direction, inverse_depth] : {std::pair(0, 0.3f), {4, 0.1f}, {8, 0.2f}}) {
    nearest_(0, 0).cell[direction] = 11 + direction;
    fitted_.data()[11 + direction] = {2, 12, 16, inverse_depth, {0, 0, inverse_depth}};
  }
  ExtendedPlanes planes;
  FindExtendedPlanes(context_, nearest_(0, 0), 0, 0, &planes);
  EXPECT_EQ(DepthQuantile(context_, 0, 0), 0.5f);
  EXPECT_EQ(DepthQuantile(context_, 2, 0), 0.5f);
  context_.near_and_far = true;
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col) {
      EXPECT_EQ(WeightedQuantile(planes, DepthQuantile(context_, col, row)), (col / 2 + row / 2) % 2 == 0 ? 8 : 4)
          << "the middle one or the farthest";
    }
  }
}

}  // namespace
}  // namespace acmp
