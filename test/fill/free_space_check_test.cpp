#include "acmp_mapping/fill/fill.h"

#include "gtest/gtest.h"

namespace acmp {
namespace {

constexpr int kWidth = 320, kHeight = 240;  // cells of 2 px
constexpr int kRoof = 120;                  // row

/// A sky over a house front at a depth of 20. All of the sky has a nearer wall's plane, as have some pixels of the
/// house that nothing speaks for. The house is textured.
class FreeSpaceCheckTest : public ::testing::Test {
 protected:
  FreeSpaceCheckTest()
      : evidence_(CellsOf(kWidth, kCell), CellsOf(kHeight, kCell)),
        planes_(kWidth, kHeight, At(20)),
        cost_(kWidth, kHeight, 0.3f) {
    for (int row = 0; row < evidence_.height(); ++row) {
      for (int col = 0; col < evidence_.width(); ++col) evidence_(col, row) = row * kCell < kRoof ? 0.0f : 50.0f;
    }
    SetSky(At(10));
  }

  static PlaneHypothesis At(float depth) { return {0, 0, -1, depth}; }
  void SetSky(const PlaneHypothesis& plane) {
    for (int row = 0; row < kRoof; ++row) {
      for (int col = 0; col < kWidth; ++col) planes_(col, row) = plane;
    }
  }
  void Check() { RemoveUnsupported(camera_, evidence_.View(), planes_.View(), cost_.View()); }
  int CountUnsupported(int first_row, int end_row) const {
    int count = 0;
    for (int row = first_row; row < end_row; ++row) {
      for (int col = 0; col < kWidth; ++col) count += cost_(col, row) == kUnsupportedCost ? 1 : 0;
    }
    return count;
  }

  static constexpr int kCell = 2;
  const PinholeCamera camera_ = {kWidth, kHeight, 300, 300, 159.5, 119.5};
  Image<float> evidence_;
  PlaneMap planes_;
  CostMap cost_;
};

TEST_F(FreeSpaceCheckTest, WhatWouldHideSomethingTexturedIsUnsupported) {
  ASSERT_EQ(EvidenceCellSize(kWidth, kHeight), kCell);
  Check();
  EXPECT_EQ(CountUnsupported(0, kRoof), kRoof * kWidth);
  EXPECT_EQ(CountUnsupported(kRoof, kHeight), 0);
  EXPECT_EQ(cost_(100, kRoof), 0.3f);
}

TEST_F(FreeSpaceCheckTest, OnlyTheNearestTexturedPixelOfADirectionCounts) {
  // A blank wall whose rim has texture, in front of the house: the rim is where it ends. It is two cells wide, as some
  // directions step over every other one.
  for (int row = kRoof - 2 * kCell; row < kRoof; ++row) {
    for (int col = 0; col < kWidth; ++col) evidence_(col / kCell, row / kCell) = 50;
  }
  Check();
  EXPECT_EQ(CountUnsupported(0, kHeight), 0);
}

TEST_F(FreeSpaceCheckTest, ThinThingsInACellOfSomethingElseStay) {
  // A post one pixel wide, which its cells' middles do not show.
  for (int row = 0; row < kRoof; ++row) planes_(100, row) = At(5);
  Check();
  ASSERT_NE(MiddleOfCell(100 / kCell, kCell, kWidth), 100);
  for (int row = 0; row < kRoof; ++row) EXPECT_EQ(cost_(100, row), 0.3f) << row;
  EXPECT_EQ(CountUnsupported(0, kRoof), kRoof * (kWidth - 1));
}

}  // namespace
}  // namespace acmp
