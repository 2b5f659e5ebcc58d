#include <algorithm>
#include <cmath>
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
      : sightings_(kWidth, kHeight),
        planes_(kWidth, kHeight),
        cost_(kWidth, kHeight),
        anchors_(kWidth / kCell, 8),
        fitted_(kWidth / kCell, 8),
        nearest_(kWidth / kCell, 8) {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.anchor_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.sightings = sightings_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.anchors = anchors_.View();
    context_.fitted = fitted_.View();
    context_.nearest = nearest_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }

  void FindAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FindAnchor(context_, col, row, SingleLane());
    }
  }
  void FitAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FitAnchor(context_, col, row, SingleLane());
    }
  }
  void FindAllNearest() {
    for (int row = 0; row < nearest_.height(); ++row) {
      for (int col = 0; col < nearest_.width(); ++col) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestAnchor(context_, col, row, i);
      }
    }
  }

  Image<Sightings> sightings_;
  PlaneMap planes_;
  CostMap cost_;
  Image<AnchorCell> anchors_, fitted_;
  Image<NearestAnchors> nearest_;
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
      sightings_(col, row) = 4;
    }
  }
  for (int views = 0; views <= 2; ++views) {
    planes_(20 + views, 15) = wrong;
    sightings_(20 + views, 15) = static_cast<Sightings>(views);
  }
  FindAll();
  FitAll();
  FindAllNearest();
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

TEST_F(CompletionKernelTest, WhatAViewNearlyConfirmsTakesAPlaneNearItsOwnDepth) {
  // A wall, a strip that nothing confirms, and a board before the wall, farther from the strip's left half.
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        board = PlaneThrough({0, 0, -1}, Ray(20, 15), 4);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      planes_(col, row) = col < 28 ? wall : board;
      cost_(col, row) = 0.1f;
      sightings_(col, row) = col >= 16 && col < 28 ? 0 : 4;
    }
  }
  const auto set = [&](int row, float depth, Sightings sightings) {
    planes_(18, row) = PlaneThrough({0, 0, -1}, Ray(18, row), depth);
    sightings_(18, row) = sightings;
  };
  set(10, 4.1f, 0);
  set(12, 4.1f, PackSightings(0, 0, true, 0));
  set(14, 4.1f, PackSightings(1, 0, true, 0));
  set(16, 4.5f, PackSightings(0, 0, true, 0));  // near neither
  FindAll();
  FitAll();
  FindAllNearest();
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) CompletePixel(context_, col, row);
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

TEST_F(CompletionKernelTest, NearestAnchorsAreTheFirstOnesOfEachDirection) {
  // Directions 0, 4, 8, 12 go right, down, left, up; 2 and 1 one and two cells right for each cell down.
  for (const auto& [col, row] : {std::pair(7, 2), {8, 2}, {3, 6}, {5, 4}, {7, 4}}) fitted_(col, row).views = 3;
  FindAllNearest();
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const NearestAnchors& nearest = nearest_(3, 2);
  EXPECT_EQ(nearest.cell[0], cell(7, 2));
  EXPECT_EQ(nearest.cell[4], cell(3, 6));
  EXPECT_EQ(nearest.cell[8], -1);
  EXPECT_EQ(nearest.cell[12], -1);
  EXPECT_EQ(nearest.cell[2], cell(5, 4));
  EXPECT_EQ(nearest.cell[1], cell(7, 4));
  for (const int own : nearest_(7, 4).cell) EXPECT_EQ(own, cell(7, 4));
}

TEST_F(CompletionKernelTest, ASureAnchorGoesBeforeANearerOneUpToEightTimesAsFarAndTwoCells) {
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const auto set = [&](int col, int row, bool is_sure) {
    fitted_(col, row).views = 3;
    fitted_(col, row).is_sure = is_sure;
  };
  // To the right of (0, row): an anchor and a sure one.
  set(0, 0, false), set(2, 0, true);
  set(0, 1, false), set(3, 1, true);
  set(1, 2, false), set(2, 2, false), set(9, 2, true);
  set(1, 3, true), set(2, 3, true);
  set(4, 4, false);
  context_.sure_views = 4;
  FindAllNearest();
  EXPECT_EQ(nearest_(0, 0).cell[0], cell(2, 0));
  EXPECT_EQ(nearest_(0, 1).cell[0], cell(0, 1)) << "three steps instead of none";
  EXPECT_EQ(nearest_(0, 2).cell[0], cell(9, 2)) << "nine steps instead of one";
  EXPECT_EQ(nearest_(0, 3).cell[0], cell(1, 3)) << "the first of the sure ones";
  EXPECT_EQ(nearest_(0, 4).cell[0], cell(4, 4)) << "there is no other";
  EXPECT_EQ(nearest_(0, 5).cell[0], -1);
  context_.sure_views = 0;
  FindAllNearest();
  for (const auto& [row, col] : {std::pair(0, 0), {1, 0}, {2, 1}, {3, 1}, {4, 4}}) {
    EXPECT_EQ(nearest_(0, row).cell[0], cell(col, row)) << "the first one";
  }
}

TEST_F(CompletionKernelTest, WhatEnoughViewsConfirmCloselyIsTheAnchorOfItsCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  sightings_(8, 4) = PackSightings(9, 2, true, 0);
  sightings_(9, 4) = PackSightings(3, 3, true, 0);
  sightings_(10, 4) = PackSightings(3, 3, true, 2);  // two sources look through it
  sightings_(16, 4) = PackSightings(4, 2, true, 0);
  context_.sure_views = 3;
  FindAll();
  EXPECT_TRUE(anchors_(2, 1).is_sure);
  EXPECT_EQ(anchors_(2, 1).col, 9) << "before one with nine views";
  EXPECT_EQ(anchors_(2, 1).views, 3);
  EXPECT_FALSE(anchors_(4, 1).is_sure);
  EXPECT_EQ(anchors_(4, 1).views, 4);
  FitAll();
  EXPECT_TRUE(fitted_(2, 1).is_sure);
  EXPECT_FALSE(fitted_(4, 1).is_sure);
  context_.sure_views = 0;
  FindAll();
  EXPECT_FALSE(anchors_(2, 1).is_sure);
  EXPECT_EQ(anchors_(2, 1).views, 9);
}

TEST_F(CompletionKernelTest, WithTheSurestFirstAPixelNeedsViewsThatConfirmItClosely) {
  const PlaneHypothesis wall = PlaneThrough({0, 0, -1}, Ray(20, 15), 5),
                        own = PlaneThrough({0, 0, -1}, Ray(20, 15), 4.9f);
  const auto complete = [&](int sure_views) {
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        planes_(col, row) = wall;
        cost_(col, row) = 0.1f;
        sightings_(col, row) = PackSightings(4, 4, true, 0);
      }
    }
    for (int close = 0; close <= 2; ++close) {
      planes_(20 + close, 15) = own;
      sightings_(20 + close, 15) = PackSightings(3, close, true, 0);
    }
    context_.sure_views = sure_views;
    FindAll();
    FitAll();
    FindAllNearest();
    for (int col = 20; col <= 22; ++col) CompletePixel(context_, col, 15);
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

/// Fronto-parallel anchors at some distance from the pixel (0, 0), in the directions that a test names.
class ExtendedPlanesTest : public CompletionKernelTest {
 protected:
  ExtendedPlanesTest() {
    for (int& cell : nearest_(0, 0).cell) cell = -1;
  }
  void SetAnchor(int direction, int cell, int distance_cells, float inverse_depth) {
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

TEST_F(ExtendedPlanesTest, NearerAnchorsCountMore) {
  // One near anchor against three that are 20 cells farther: each of those weighs exp(-20 / 12) = 0.19.
  SetAnchor(0, 11, 25, 0.1f), SetAnchor(4, 12, 25, 0.2f), SetAnchor(8, 13, 25, 0.3f), SetAnchor(12, 14, 5, 0.4f);
  const ExtendedPlanes planes = Find();
  EXPECT_NEAR(planes.weight[0], std::exp(-20 / 12.0), 1e-6);
  EXPECT_EQ(planes.weight[12], 1);
  EXPECT_EQ(planes.weight[1], 0);
  EXPECT_EQ(planes.inverse_depth[8], 0.3f);
  EXPECT_EQ(WeightedQuantile(planes, 0.5f), 12);
}

TEST_F(ExtendedPlanesTest, OfEqualWeightsTheOneInTheMiddleIsTheMedian) {
  SetAnchor(0, 11, 5, 0.3f), SetAnchor(4, 12, 5, 0.1f), SetAnchor(8, 13, 5, 0.2f);
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 8);
  nearest_(0, 0).cell[0] = -1;  // of two the first
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 4);
  nearest_(0, 0).cell[4] = -1;
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), 8);
  SetAnchor(8, 13, 5, 1 / 0.9f);  // nearer than the depth range
  EXPECT_EQ(WeightedQuantile(Find(), 0.5f), -1);
}

TEST_F(ExtendedPlanesTest, SharesCountFromTheFarthest) {
  SetAnchor(0, 11, 5, 0.3f), SetAnchor(4, 12, 5, 0.1f), SetAnchor(8, 13, 5, 0.2f), SetAnchor(12, 14, 5, 0.4f);
  for (const auto& [share, direction] : {std::pair(0.0f, 4), {0.2f, 4}, {0.3f, 8}, {0.7f, 0}, {0.8f, 12}, {1.0f, 12}}) {
    EXPECT_EQ(WeightedQuantile(Find(), share), direction) << share;
  }
}

TEST_F(ExtendedPlanesTest, AlternativesTakeTurnsByBlocks) {
  SetAnchor(0, 11, 5, 0.3f), SetAnchor(4, 12, 5, 0.1f), SetAnchor(8, 13, 5, 0.2f);
  context_.alternatives = false;
  EXPECT_EQ(ShareBehind(context_, 0, 0), 0.5f);
  EXPECT_EQ(ShareBehind(context_, 2, 0), 0.5f);
  context_.alternatives = true;
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col) {
      const int direction = WeightedQuantile(Find(), ShareBehind(context_, col, row));
      EXPECT_EQ(direction, (col / 2 + row / 2) % 2 == 0 ? 8 : 4) << "the middle one or the farthest";
    }
  }
}

}  // namespace
}  // namespace acmp
