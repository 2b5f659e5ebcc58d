#include <algorithm>

#include "completion/completion_kernel_fixture.h"

namespace acmp {
namespace {

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
  EXPECT_EQ(CompletionCellSize(640, 480), 6);
  EXPECT_EQ(CompletionCellSize(480, 640), 6);
  EXPECT_EQ(CompletionCellSize(3072, 2048), 28);
  EXPECT_EQ(CompletionCellSize(20, 15), 1);
  EXPECT_EQ(CellsOf(640, 4), 160);
  EXPECT_EQ(CellsOf(641, 4), 161);
}

TEST_F(CompletionKernelTest, AnchorIsTheMostConfirmedPixelOfTheCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  const auto set = [&](int col, int row, int views, float cost) {
    sightings_(col, row) = static_cast<Sightings>(views);
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

TEST(SightingsTest, AreCountedUpToWhatTheirBitsHold) {
  for (const bool is_nearly_confirmed : {false, true}) {
    for (const int confirming : {0, 1, 30, 31, 32, 500}) {
      for (const int closely : {0, 1, 31, 32, 500}) {
        for (const int looking_through : {0, 1, 3, 4, 500}) {
          const Sightings sightings = PackSightings(confirming, closely, is_nearly_confirmed, looking_through);
          EXPECT_EQ(ConfirmingViews(sightings), std::min(confirming, 31));
          EXPECT_EQ(CloselyConfirmingViews(sightings), std::min(closely, 31));
          EXPECT_EQ(IsNearlyConfirmed(sightings), is_nearly_confirmed);
          EXPECT_EQ(LookingThrough(sightings), std::min(looking_through, 3));
        }
      }
    }
  }
}

TEST_F(CompletionKernelTest, WhatTwoSourcesLookThroughIsNoAnchor) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  sightings_(9, 5) = PackSightings(9, 0, false, 2);
  sightings_(10, 5) = 2;
  sightings_(14, 6) = PackSightings(3, 0, false, 3);
  sightings_(17, 6) = PackSightings(3, 0, false, 1);
  FindAll();
  EXPECT_EQ(anchors_(2, 1).views, 2);
  EXPECT_EQ(anchors_(2, 1).col, 10);
  EXPECT_EQ(anchors_(3, 1).views, 0);
  EXPECT_EQ(anchors_(4, 1).views, 3);
}

TEST_F(CompletionKernelTest, FitFindsThePlaneOfTheSurroundingsDespiteABadNormalAndOutliers) {
  const PlaneHypothesis wall = PlaneThrough(Normalized(Vec3f{0.5f, 0.1f, -1}), Ray(20, 15), 4);
  const PlaneHypothesis front = {0, 0, -1, 2.5f};
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      const PlaneHypothesis& surface = col > 27 ? front : wall;
      // The right depth with a normal that faces the camera: 25 degrees off.
      planes_(col, row) = PlaneThrough({0, 0, -1}, Ray(col, row), DepthAt(surface, col, row));
      sightings_(col, row) = 3;
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
  sightings_(18, 14) = 2;
  FindAll();
  FitAll();
  EXPECT_NEAR(DepthAt(PlaneOfInverse(fitted_(4, 3).inverse_plane), 30, 20), DepthAt(planes_(18, 14), 30, 20), 1e-5);
}

}  // namespace
}  // namespace acmp
