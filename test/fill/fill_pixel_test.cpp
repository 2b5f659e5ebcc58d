#include "fill/fill_kernel_fixture.h"

namespace acmp {
namespace {

TEST_F(FillKernelTest, WhatTooFewViewsConfirmTakesThePlaneAroundAndACostThatSaysHowLittleIsKnown) {
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        wrong = PlaneThrough({0, 0, -1}, Ray(20, 15), 2);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      planes_(col, row) = wall;
      cost_(col, row) = 0.1f;
      support_(col, row) = 4;
    }
  }
  for (int views = 0; views <= 2; ++views) {
    planes_(20 + views, 15) = wrong;
    support_(20 + views, 15) = static_cast<ViewSupport>(views);
  }
  FindAll();
  FitAll();
  FindAllNearest();
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) FillPixel(context_, col, row);
  }
  // The fit is pulled to zero slope by a ten-thousandth.
  for (const int views : {0, 1}) EXPECT_NEAR(DepthAt(planes_(20 + views, 15), 20 + views, 15), 5, 5e-3);
  EXPECT_EQ(cost_(20, 15), kWorstCost);
  EXPECT_EQ(cost_(21, 15), kUnverifiedCost);
  EXPECT_EQ(planes_(22, 15).d, wrong.d);
  EXPECT_EQ(cost_(22, 15), 0.1f);
  EXPECT_EQ(planes_(10, 10).d, wall.d);
}

TEST_F(FillKernelTest, WhatAViewNearlyConfirmsTakesAPlaneNearItsOwnDepth) {
  // A wall, a strip that nothing confirms, and a board before the wall, farther from the strip's left half.
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        board = PlaneThrough({0, 0, -1}, Ray(20, 15), 4);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      planes_(col, row) = col < 28 ? wall : board;
      cost_(col, row) = 0.1f;
      support_(col, row) = col >= 16 && col < 28 ? 0 : 4;
    }
  }
  const auto set = [&](int row, float depth, ViewSupport support) {
    planes_(18, row) = PlaneThrough({0, 0, -1}, Ray(18, row), depth);
    support_(18, row) = support;
  };
  set(10, 4.1f, 0);
  set(12, 4.1f, PackViewSupport(0, 0, true, 0));
  set(14, 4.1f, PackViewSupport(1, 0, true, 0));
  set(16, 4.5f, PackViewSupport(0, 0, true, 0));  // near neither
  FindAll();
  FitAll();
  FindAllNearest();
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) FillPixel(context_, col, row);
  }
  // The fit is pulled to zero slope by a ten-thousandth.
  EXPECT_NEAR(DepthAt(planes_(18, 10), 18, 10), 5, 5e-3);
  EXPECT_NEAR(DepthAt(planes_(18, 12), 18, 12), 4, 5e-3);
  EXPECT_EQ(cost_(18, 12), kWorstCost);
  EXPECT_NEAR(DepthAt(planes_(18, 14), 18, 14), 4, 5e-3);
  EXPECT_EQ(cost_(18, 14), kUnverifiedCost);
  EXPECT_FLOAT_EQ(DepthAt(planes_(18, 16), 18, 16), 4.5f);
  EXPECT_EQ(cost_(18, 16), 0.1f);
}

TEST_F(FillKernelTest, WithTheStrongSeedsFirstAPixelNeedsViewsThatConfirmItClosely) {
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        own = PlaneThrough({0, 0, -1}, Ray(20, 15), 4.9f);
  const auto complete = [&](int strong_views) {
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        planes_(col, row) = wall;
        cost_(col, row) = 0.1f;
        support_(col, row) = PackViewSupport(4, 4, true, 0);
      }
    }
    for (int close = 0; close <= 2; ++close) {
      planes_(20 + close, 15) = own;
      support_(20 + close, 15) = PackViewSupport(3, close, true, 0);
    }
    context_.strong_views = strong_views;
    FindAll();
    FitAll();
    FindAllNearest();
    for (int col = 20; col <= 22; ++col) FillPixel(context_, col, 15);
  };
  complete(0);
  for (int col = 20; col <= 22; ++col) EXPECT_EQ(cost_(col, 15), 0.1f) << "three views confirm it";
  complete(3);
  EXPECT_EQ(cost_(20, 15), kWorstCost);
  EXPECT_EQ(cost_(21, 15), kUnverifiedCost);
  EXPECT_EQ(cost_(22, 15), 0.1f);
  // The fit is pulled to zero slope by a ten-thousandth.
  EXPECT_NEAR(DepthAt(planes_(20, 15), 20, 15), 5, 5e-3);
  EXPECT_EQ(planes_(22, 15).d, own.d);
}

}  // namespace
}  // namespace acmp
