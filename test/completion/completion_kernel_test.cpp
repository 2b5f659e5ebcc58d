#include <set>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/completion/kernel/complete_pixel.h"
#include "acmp_mapping/completion/kernel/fit_anchor.h"

namespace acmp {
namespace {

/// Maps and anchors of an image of 40 x 30 px in cells of 4 px.
class CompletionKernelTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 30, kCell = 4;

  CompletionKernelTest()
      : confirming_(kWidth, kHeight),
        planes_(kWidth, kHeight),
        cost_(kWidth, kHeight),
        anchors_(kWidth / kCell, 8),
        fitted_(kWidth / kCell, 8) {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.anchor_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.confirming = confirming_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.anchors = anchors_.View();
    context_.fitted = fitted_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }

  void FindAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FindAnchor(context_, col, row);
    }
  }
  void FitAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FitAnchor(context_, col, row, SingleLane());
    }
  }

  Image<unsigned char> confirming_;
  PlaneMap planes_;
  CostMap cost_;
  Image<AnchorCell> anchors_, fitted_;
  CompletionContext context_ = {};
};

TEST_F(CompletionKernelTest, InversePlaneIsInverseDepthAlongRays) {
  const PlaneHypothesis plane = PlaneThrough(Normalized(Vec3f{0.3f, -0.2f, -1}), Ray(7, 9), 4);
  EXPECT_NEAR(Dot(InversePlane(plane), Ray(30, 2)), 1 / DepthAt(plane, 30, 2), 1e-6);
  const PlaneHypothesis back = PlaneOfInverse(InversePlane(plane));
  EXPECT_NEAR(back.nx, plane.nx, 1e-6);
  EXPECT_NEAR(back.ny, plane.ny, 1e-6);
  EXPECT_NEAR(back.nz, plane.nz, 1e-6);
  EXPECT_NEAR(back.d, plane.d, 1e-5);
  EXPECT_EQ(PlaneOfInverse({0, 0, 0}).d, 0) << "a plane at infinity is none";
}

TEST_F(CompletionKernelTest, CellsCoverTheImageAndGrowWithIt) {
  EXPECT_EQ(CompletionCellSize(640, 480), 4);
  EXPECT_EQ(CompletionCellSize(480, 640), 4);
  EXPECT_EQ(CompletionCellSize(3072, 2048), 19);
  EXPECT_EQ(CompletionCellSize(20, 15), 1);
  EXPECT_EQ(CellsOf(640, 4), 160);
  EXPECT_EQ(CellsOf(641, 4), 161);
}

TEST_F(CompletionKernelTest, AnchorIsTheMostConfirmedPixelOfTheCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  const auto set = [&](int col, int row, int views, float cost) {
    confirming_(col, row) = static_cast<unsigned char>(views);
    cost_(col, row) = cost;
  };
  set(5, 4, 1, 0.01f);                                           // too few
  set(9, 5, 2, 0.3f), set(10, 5, 2, 0.2f), set(11, 5, 2, 0.2f);  // the least cost, the first of two
  set(13, 5, 2, 0.1f), set(14, 6, 3, 0.9f);                      // views count more than cost
  set(39, 29, 4, 0.5f);                                          // in the last, cut-off cell
  planes_(10, 5) = {0, 0, -1, 8};
  FindAll();
  EXPECT_EQ(anchors_(1, 1).views, 0);
  EXPECT_EQ(anchors_(2, 1).col, 10);
  EXPECT_EQ(anchors_(2, 1).row, 5);
  EXPECT_FLOAT_EQ(anchors_(2, 1).inverse_depth, 1 / 8.0f);
  EXPECT_EQ(anchors_(3, 1).views, 3);
  EXPECT_EQ(anchors_(3, 1).col, 14);
  EXPECT_EQ(anchors_(9, 7).col, 39);
  EXPECT_EQ(anchors_(9, 7).row, 29);
}

TEST_F(CompletionKernelTest, FitFindsThePlaneOfTheSurroundingsDespiteABadNormalAndOutliers) {
  const PlaneHypothesis wall = PlaneThrough(Normalized(Vec3f{0.5f, 0.1f, -1}), Ray(20, 15), 4);
  const PlaneHypothesis front = {0, 0, -1, 2.5f};
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      const PlaneHypothesis& surface = col > 27 ? front : wall;
      // The right depth with a normal that faces the camera: 25 degrees off.
      planes_(col, row) = PlaneThrough({0, 0, -1}, Ray(col, row), DepthAt(surface, col, row));
      confirming_(col, row) = 3;
    }
  }
  FindAll();
  FitAll();
  const PlaneHypothesis fitted = PlaneOfInverse(fitted_(3, 3).inverse_plane);
  // The front plane is off by 60 % of its depth, far beyond the tolerance of 3 %: exact but for rounding and the ridge.
  EXPECT_NEAR(DepthAt(fitted, 13, 13), DepthAt(wall, 13, 13), 2e-3);
  EXPECT_NEAR(DepthAt(fitted, 27, 2), DepthAt(wall, 27, 2), 5e-3);
  EXPECT_GT(Dot(fitted.normal(), wall.normal()), 0.9999f);
  EXPECT_EQ(fitted_(3, 3).col, anchors_(3, 3).col);
}

TEST_F(CompletionKernelTest, AnAnchorAloneKeepsThePlaneOfItsPixel) {
  planes_(18, 14) = PlaneThrough(Normalized(Vec3f{0.2f, 0, -1}), Ray(18, 14), 3);
  confirming_(18, 14) = 2;
  FindAll();
  FitAll();
  EXPECT_NEAR(DepthAt(PlaneOfInverse(fitted_(4, 3).inverse_plane), 30, 20), DepthAt(planes_(18, 14), 30, 20), 1e-5);
}

TEST_F(CompletionKernelTest, DirectionsGoRoundTheCompass) {
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

TEST_F(CompletionKernelTest, WhatTooFewViewsConfirmTakesThePlaneAroundAndACostThatSaysHowLittleIsKnown) {
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        wrong = PlaneThrough({0, 0, -1}, Ray(20, 15), 2);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      planes_(col, row) = wall;
      cost_(col, row) = 0.1f;
      confirming_(col, row) = 4;
    }
  }
  for (int views = 0; views <= 2; ++views) {
    planes_(20 + views, 15) = wrong;
    confirming_(20 + views, 15) = static_cast<unsigned char>(views);
  }
  FindAll();
  FitAll();
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) CompletePixel(context_, col, row);
  }
  // The fit is pulled to zero slope by a ten-thousandth.
  for (const int views : {0, 1}) EXPECT_NEAR(DepthAt(planes_(20 + views, 15), 20 + views, 15), 5, 5e-3);
  EXPECT_EQ(cost_(20, 15), kWorstCost);
  EXPECT_EQ(cost_(21, 15), kUnverifiedCost);
  EXPECT_EQ(planes_(22, 15).d, wrong.d);
  EXPECT_EQ(cost_(22, 15), 0.1f);
  EXPECT_EQ(planes_(10, 10).d, wall.d);
}

TEST(WeightedMedianTest, NearerAnchorsCountMore) {
  // One near anchor against three that are 20 cells farther: each of those weighs exp(-20 / 9.6) = 0.12.
  const ExtendedPlane sorted[] = {{0.1f, 21, 0}, {0.2f, 21, 1}, {0.3f, 21, 2}, {0.4f, 1, 3}};
  EXPECT_EQ(WeightedMedian(sorted, 4), 3);
  const ExtendedPlane equal[] = {{0.1f, 5, 0}, {0.2f, 5, 1}, {0.3f, 5, 2}};
  EXPECT_EQ(WeightedMedian(equal, 3), 1);
  EXPECT_EQ(WeightedMedian(equal, 1), 0);
}

}  // namespace
}  // namespace acmp
