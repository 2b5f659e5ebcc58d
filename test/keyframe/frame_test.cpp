#include "acmp_mapping/keyframe/frame.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

const PinholeCamera kCamera = {6, 4, 5.0, 5.5, 2.5, 1.5};

ColorImage MakeColor(int width, int height) {
  ColorImage color(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      color(col, row) = {static_cast<unsigned char>(10 * col), static_cast<unsigned char>(20 * row),
                         static_cast<unsigned char>(3 * col + 7 * row)};
    }
  }
  return color;
}

double Gray(const Rgb& c) { return 0.299 * c.r + 0.587 * c.g + 0.114 * c.b; }

TEST(MakeFrameTest, AveragesGrayInFloatWhenShrinking) {
  const ColorImage color = MakeColor(6, 4);
  const Frame frame = MakeFrame(0, 0, color.Clone(), kCamera, RigidTransform::Identity(), {}, {3});
  ASSERT_EQ(frame.gray.width(), 3);
  ASSERT_EQ(frame.gray.height(), 2);
  ASSERT_EQ(frame.color.width(), 3);
  for (int row = 0; row < 2; ++row) {
    for (int col = 0; col < 3; ++col) {
      const double mean = (Gray(color(2 * col, 2 * row)) + Gray(color(2 * col + 1, 2 * row)) +
                           Gray(color(2 * col, 2 * row + 1)) + Gray(color(2 * col + 1, 2 * row + 1))) /
                          4;
      // Below the 0.5 that rounding to 8 bits in between would cost.
      EXPECT_NEAR(frame.gray(col, row), mean, 1e-3);
    }
  }
  EXPECT_DOUBLE_EQ(frame.camera.fx, 2.5);
  EXPECT_DOUBLE_EQ(frame.camera.cx, (2.5 + 0.5) * 0.5 - 0.5);
}

TEST(MakeFrameTest, PriorDepthOfAnySizeTakesTheFramesSizeWithoutInterpolation) {
  DepthMap depth(3, 2);
  const float values[] = {1, 2, -1, 4, NAN, INFINITY};
  std::copy(std::begin(values), std::end(values), depth.begin());
  const auto make = [&](int max_size, const DepthMap& of_image) {
    return MakeFrame(0, 0, MakeColor(6, 4), kCamera, RigidTransform::Identity(), {}, {max_size}, {}, of_image);
  };
  const Frame enlarged = make(0, depth);
  ASSERT_EQ(enlarged.prior_depth.width(), 6);
  ASSERT_EQ(enlarged.prior_depth.height(), 4);
  const std::vector<float> rows[] = {{1, 1, 2, 2, 0, 0}, {4, 4, 0, 0, 0, 0}};
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 6; ++col)
      EXPECT_EQ(enlarged.prior_depth(col, row), rows[row / 2][col]) << col << " " << row;
  }
  const Frame same = make(3, depth);
  EXPECT_EQ(same.prior_depth(1, 0), 2);
  EXPECT_EQ(same.prior_depth(1, 1), 0) << "not a number: unknown";
  EXPECT_TRUE(make(3, {}).prior_depth.empty());
}

TEST(MakeFrameTest, MaskIsResizedWithTheImageAndLandmarksOnItAreLeftOut) {
  Mask mask(6, 4, 200);
  mask(2, 1) = 0;
  const auto at = [](double col, double row) -> Eigen::Vector3d { return 2.0 * kCamera.Unproject({col, row}); };
  const std::vector<Eigen::Vector3d> landmarks = {at(2, 1), at(4, 1), {0, 0, -1}};
  const auto make = [&](int max_size, const Mask& of_image) {
    return MakeFrame(0, 0, MakeColor(6, 4), kCamera, RigidTransform::Identity(), landmarks, {max_size}, of_image);
  };
  const Frame frame = make(0, mask);
  ASSERT_EQ(frame.mask.width(), 6);
  EXPECT_EQ(frame.mask(2, 1), 0);
  EXPECT_NE(frame.mask(1, 1), 0);
  ASSERT_EQ(frame.landmarks_in_world.size(), 2u);  // behind the camera: not seen, whatever the mask
  EXPECT_EQ(frame.landmarks_in_world[0], landmarks[1]);

  const Frame shrunk = make(3, mask);
  ASSERT_EQ(shrunk.mask.width(), 3);
  EXPECT_EQ(shrunk.mask(1, 0), 0);
  EXPECT_NE(shrunk.mask(0, 0), 0);
  EXPECT_EQ(shrunk.landmarks_in_world.size(), 2u);

  const Frame whole = make(0, Mask(6, 4, 1));
  EXPECT_TRUE(whole.mask.empty()) << "ignores nothing";
  EXPECT_EQ(whole.landmarks_in_world.size(), 3u);
  EXPECT_THAT(ErrorOf([&] { make(0, Mask(4, 6, 255)); }),
              ::testing::AllOf(HasSubstr("mask size 4 x 6"), HasSubstr("6 x 4")));
}

// At every count: a vectorised loop and its remainder are compiled differently.
TEST(RoundedToFloatTest, EveryCoordinateIsAFloat) {
  for (size_t count = 0; count < 20; ++count) {
    std::vector<Eigen::Vector3d> points;
    for (size_t i = 0; i < count; ++i) points.emplace_back(0.1 * static_cast<double>(i + 1), 0.2, -1e-9);
    const std::vector<Eigen::Vector3d> rounded = RoundedToFloat(points);
    ASSERT_EQ(rounded.size(), count);
    for (size_t i = 0; i < count; ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        volatile float expected = static_cast<float>(points[i][axis]);  // volatile: not subject to what is tested
        EXPECT_EQ(rounded[i][axis], static_cast<double>(expected)) << count << " points, " << i << ", axis " << axis;
      }
    }
  }
}

}  // namespace
}  // namespace acmp
