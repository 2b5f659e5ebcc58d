#include <algorithm>

#include "fill/fill_kernel_fixture.h"

namespace acmp {
namespace {

TEST_F(FillKernelTest, InversePlaneIsInverseDepthAlongRays) {
  const PlaneHypothesis plane = PlaneThrough(Normalized(Vec3f{0.3f, -0.2f, -1}), Ray(7, 9), 4);
  EXPECT_NEAR(Dot(InversePlane(plane), Ray(30, 2)), 1 / DepthAt(plane, 30, 2), 1e-6);
  const PlaneHypothesis back = PlaneOfInverse(InversePlane(plane));
  EXPECT_NEAR(back.nx, plane.nx, 1e-6);
  EXPECT_NEAR(back.ny, plane.ny, 1e-6);
  EXPECT_NEAR(back.nz, plane.nz, 1e-6);
  EXPECT_NEAR(back.d, plane.d, 1e-5);
  EXPECT_EQ(PlaneOfInverse({0, 0, 0}).d, 0) << "a plane at infinity is none";
}

TEST_F(FillKernelTest, CellsCoverTheImageAndGrowWithIt) {
  EXPECT_EQ(FillCellSize(640, 480), 6);
  EXPECT_EQ(FillCellSize(480, 640), 6);
  EXPECT_EQ(FillCellSize(3072, 2048), 28);
  EXPECT_EQ(FillCellSize(20, 15), 1);
  EXPECT_EQ(CellsOf(640, 4), 160);
  EXPECT_EQ(CellsOf(641, 4), 161);
}

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

TEST(ViewSupportTest, AreCountedUpToWhatTheirBitsHold) {
  for (const bool is_loosely_consistent : {false, true}) {
    for (const int confirming : {0, 1, 30, 31, 32, 500}) {
      for (const int closely : {0, 1, 31, 32, 500}) {
        for (const int free_space_violations : {0, 1, 3, 4, 500}) {
          const ViewSupport support =
              PackViewSupport(confirming, closely, is_loosely_consistent, free_space_violations);
          EXPECT_EQ(ConsistentViews(support), std::min(confirming, 31));
          EXPECT_EQ(StrictlyConsistentViews(support), std::min(closely, 31));
          EXPECT_EQ(IsLooselyConsistent(support), is_loosely_consistent);
          EXPECT_EQ(FreeSpaceViolations(support), std::min(free_space_violations, 3));
        }
      }
    }
  }
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
  FitAll();
  const PlaneHypothesis fitted = PlaneOfInverse(fitted_(3, 3).inverse_plane);
  // The front plane is off by 60 % of its depth, far beyond the tolerance of 3 %: exact but for rounding and the ridge.
  EXPECT_NEAR(DepthAt(fitted, 13, 13), DepthAt(wall, 13, 13), 2e-3);
  EXPECT_NEAR(DepthAt(fitted, 27, 2), DepthAt(wall, 27, 2), 5e-3);
  EXPECT_GT(Dot(fitted.normal(), wall.normal()), 0.9999f);
  EXPECT_EQ(fitted_(3, 3).col, seeds_(3, 3).col);
}

TEST_F(FillKernelTest, AnSeedAloneKeepsThePlaneOfItsPixel) {
  planes_(18, 14) = PlaneThrough(Normalized(Vec3f{0.2f, 0, -1}), Ray(18, 14), 3);
  support_(18, 14) = 2;
  FindAll();
  FitAll();
  EXPECT_NEAR(DepthAt(PlaneOfInverse(fitted_(4, 3).inverse_plane), 30, 20), DepthAt(planes_(18, 14), 30, 20), 1e-5);
}

}  // namespace
}  // namespace acmp
