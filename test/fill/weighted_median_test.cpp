#include "acmp_mapping/fill/kernel/weighted_median.h"

#include "gtest/gtest.h"

#include "acmp_mapping/fill/kernel/fill_pixel.h"

namespace acmp {
namespace {

/// Two walls side by side at depths of 4 and 2, white and black.
class FilterPixelTest : public ::testing::Test {
 protected:
  static constexpr int kSize = 60, kEdge = 30;

  FilterPixelTest()
      : planes_(kSize, kSize),
        depth_(kSize, kSize),
        support_(kSize, kSize),
        color_(kSize, kSize),
        filtered_(kSize, kSize),
        cost_(kSize, kSize, 0.1f) {
    const RayGrid rays = {1 / 50.0f, 1 / 50.0f, 29.5f, 29.5f};
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) {
        const bool is_left = col < kEdge;
        SetDepth(col, row, is_left ? 4.0f : 2.0f);
        color_(col, row) = is_left ? Rgb{255, 255, 255} : Rgb{0, 0, 0};
      }
    }
    context_ = {rays,        1, 20, planes_.View(), depth_.View(), support_.View(), color_.View(), filtered_.View(),
                cost_.View()};
  }

  void SetDepth(int col, int row, float depth) {
    planes_(col, row) = {0, 0, -1, depth};
    depth_(col, row) = depth;
  }
  float Filtered(int col, int row) {
    WeightedMedianPixel(context_, col, row);
    return filtered_(col, row).d;
  }

  PlaneMap planes_;
  DepthMap depth_;
  Image<ViewSupport> support_;
  ColorImage color_;
  PlaneMap filtered_;
  CostMap cost_;
  MedianContext context_ = {};
};

TEST_F(FilterPixelTest, WhatSourcesSeeThroughHasLessSay) {
  // All of the left half that the filter sees from there but a column of samples has the wrong depth: nine times the
  // weight of that column, and a quarter of it for each source that violates.
  const auto filtered_with = [&](int free_space_violations) {
    for (int row = 0; row < kSize; ++row) {
      for (int col = 13; col < kEdge; ++col) {
        SetDepth(col, row, 2);
        support_(col, row) = PackViewSupport(4, 4, false, free_space_violations);
      }
    }
    return Filtered(24, 30);
  };
  EXPECT_NEAR(filtered_with(0), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(1), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(2), 4, 1e-5f);
  EXPECT_NEAR(filtered_with(9), 4, 1e-5f);
  for (ViewSupport& support : support_) support = PackViewSupport(4, 4, false, 3);
  EXPECT_NEAR(Filtered(24, 30), 2, 1e-5f) << "the same of all changes nothing";
}

TEST_F(FilterPixelTest, PlanesThatFaceAwayTiltTooMuchOrLeaveTheRangeAreNotExtended) {
  const Vec3f from = context_.rays.Ray(36, 30), to = context_.rays.Ray(40, 30);
  const PlaneHypothesis slanted = PlaneThrough(Normalized(Vec3f{0.5f, 0, -1}), from, 4);
  const float extended = PlaneDepth(slanted, to);
  ASSERT_GT(extended, 4.1f);
  ASSERT_LT(extended, 4.4f);
  EXPECT_NEAR(ExtendedDepth(context_, slanted, to, 4), extended, 1e-5f);
  const PlaneHypothesis away = {-slanted.nx, -slanted.ny, -slanted.nz, -slanted.d};
  EXPECT_EQ(ExtendedDepth(context_, away, to, 4), 0);
  EXPECT_EQ(ExtendedDepth(context_, PlaneThrough(Normalized(Vec3f{1, 0, -0.3f}), from, 4), to, 4), 4) << "by over 10 %";
  context_.depth_max = 4.1f;
  EXPECT_EQ(ExtendedDepth(context_, slanted, to, 4), 4);
  context_.depth_max = 20;
  context_.depth_min = 4.9f;
  EXPECT_EQ(ExtendedDepth(context_, slanted, to, 4), 4);
}

}  // namespace
}  // namespace acmp
