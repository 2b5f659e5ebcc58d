// Planes that completion does not extend in front of what is evidently farther away.

#include "completion/completion_kernel_fixture.h"

namespace acmp {
namespace {

constexpr int kBlankBegin = 12, kBlankEnd = 28;  // columns

/// A wall at a depth of 5, evident at the left, a blank strip that nothing confirms, and a confirmed board at a depth
/// of 4 at the right, of which nothing is evident. The pixel of the strip that is asked takes the nearer of two
/// alternatives, which is the board's plane if that counts, as the wall's has less than 0.65 of the weight.
class HideEvidentTest : public CompletionKernelTest {
 protected:
  HideEvidentTest()
      : evidence_(anchors_.width(), anchors_.height()),
        evident_(anchors_.width(), anchors_.height()),
        nearest_evident_(anchors_.width(), anchors_.height()) {
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        planes_(col, row) = PlaneThrough({0, 0, -1}, Ray(col, row), col < kBlankEnd ? 5.0f : 4.0f);
        cost_(col, row) = 0.1f;
        const bool is_blank = col >= kBlankBegin && col < kBlankEnd;
        sightings_(col, row) = is_blank ? PackSightings(0, 0, false, 0, true) : PackSightings(4, 4, true, 0, true);
      }
    }
    SetEvident(kBlankBegin / kCell);
    context_.alternatives = true;
  }

  /// The first `cols` columns of cells.
  void SetEvident(int cols) {
    for (int row = 0; row < evidence_.height(); ++row) {
      for (int col = 0; col < evidence_.width(); ++col) evidence_(col, row) = col < cols ? 50.0f : 0.0f;
    }
  }

  /// Depth of a pixel of the strip, completed.
  float CompletedDepth(int col = kCol, int row = kRow) {
    FindPlanes();
    return DepthAmongPlanes(col, row);
  }

  void FindPlanes() {
    FindAll();
    FitAll();
    FindAllNearest();
  }

  float DepthAmongPlanes(int col = kCol, int row = kRow) {
    CompletionContext search = context_;
    search.fitted = evident_.View();
    search.nearest = nearest_evident_.View();
    for (int r = 0; r < evident_.height(); ++r) {
      for (int c = 0; c < evident_.width(); ++c) FindEvidentOrAnchor(search, evidence_.View(), c, r);
    }
    for (int r = 0; r < evident_.height(); ++r) {
      for (int c = 0; c < evident_.width(); ++c) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestAnchor(search, c, r, i);
      }
    }
    context_.evident = evident_.View();
    context_.nearest_evident = nearest_evident_.View();
    context_.evident_cell_size = kCell;
    CompletePixel(context_, col, row);
    return DepthAt(planes_(col, row), col, row);
  }

  static constexpr int kCol = 18, kRow = 14;  // the wall has 0.56 of the weight
  Image<float> evidence_;
  Image<AnchorCell> evident_;
  Image<NearestAnchors> nearest_evident_;
};

// The fits are pulled to zero slope by a ten-thousandth.
constexpr float kTolerance = 5e-3f;

TEST_F(HideEvidentTest, APlaneInFrontOfWhatIsEvidentDoesNotCount) {
  EXPECT_NEAR(CompletedDepth(), 5, kTolerance);
  EXPECT_EQ(cost_(kCol, kRow), kWorstCost);
}

TEST_F(HideEvidentTest, WhereNothingIsEvidentTheNearestCount) {
  SetEvident(0);
  EXPECT_NEAR(CompletedDepth(), 4, kTolerance);
}

TEST_F(HideEvidentTest, WhatLiesBeyondAnAnchorIsOfAnotherSurface) {
  // Two columns of cells, as some directions step over every other one.
  SetEvident(kBlankBegin / kCell - 2);
  EXPECT_NEAR(CompletedDepth(), 4, kTolerance);
}

TEST_F(HideEvidentTest, WherePlanesThatHideHaveMostOfTheWeightTheyCount) {
  EXPECT_NEAR(CompletedDepth(kCol + 4), 4, kTolerance);  // the wall has 0.38
}

TEST_F(HideEvidentTest, AnAnchorThatTwoSourcesLookThroughIsNone) {
  SetEvident(kBlankBegin / kCell - 2);
  FindPlanes();
  for (int row = 0; row < kHeight; ++row) {
    for (int col = kBlankBegin - 2 * kCell; col < kBlankBegin; ++col) {
      sightings_(col, row) = PackSightings(4, 4, true, 2, true);
    }
  }
  EXPECT_NEAR(DepthAmongPlanes(), 5, kTolerance);
}

TEST_F(HideEvidentTest, WhereFewSourcesLookLessIsEvidentThanThereIs) {
  sightings_(kCol, kRow) = PackSightings(0, 0, false, 0, false);
  EXPECT_NEAR(CompletedDepth(), 4, kTolerance);
}

TEST_F(HideEvidentTest, WhereAllPlanesWouldHideSomethingTheyCount) {
  // The wall is farther away than any plane that could be extended.
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kBlankBegin; ++col) {
      planes_(col, row) = PlaneThrough({0, 0, -1}, Ray(col, row), 9);
      sightings_(col, row) = PackSightings(0, 0, false, 0, true);
    }
  }
  EXPECT_NEAR(CompletedDepth(), 4, kTolerance);
}

}  // namespace
}  // namespace acmp
