#include "acmp_mapping/geometry/pinhole_camera.h"

#include <Eigen/LU>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

const PinholeCamera kVgaCamera = {640, 480, 525.5, 520.25, 311.75, 244.5};

TEST(PinholeCameraTest, ProjectsAsItsMatrixDoes) {
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 0.01}}) {
    const Eigen::Vector3d homogeneous = kVgaCamera.K() * point;
    const Eigen::Vector2d pixel = kVgaCamera.Project(point);
    EXPECT_NEAR(pixel.x(), homogeneous.x() / homogeneous.z(), 1e-9);  // double rounding of hundreds of px
    EXPECT_NEAR(pixel.y(), homogeneous.y() / homogeneous.z(), 1e-9);
    EXPECT_NEAR((kVgaCamera.Unproject(pixel, point.z()) - point).norm(), 0, 1e-12);
  }
  EXPECT_NEAR((kVgaCamera.Unproject({7, 8}) - kVgaCamera.K().inverse() * Eigen::Vector3d(7, 8, 1)).norm(), 0, 1e-12);
}

TEST(PinholeCameraTest, ContainsPixelsWhoseRoundedPositionIsInside) {
  EXPECT_TRUE(kVgaCamera.Contains({0, 0}));
  EXPECT_TRUE(kVgaCamera.Contains({-0.5, -0.5}));
  EXPECT_TRUE(kVgaCamera.Contains({639.49, 479.49}));
  EXPECT_FALSE(kVgaCamera.Contains({-0.51, 0}));
  EXPECT_FALSE(kVgaCamera.Contains({0, -0.51}));
  EXPECT_FALSE(kVgaCamera.Contains({639.5, 0}));
  EXPECT_FALSE(kVgaCamera.Contains({0, 479.5}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(kVgaCamera.Contains({nan, 3}));
  EXPECT_FALSE(kVgaCamera.Contains({3, nan}));
}

TEST(PinholeCameraTest, ResizedKeepsWhatEachPixelAreaSees) {
  // With centres at integers, pixel u covers [u - 0.5, u + 0.5]: u -> (u + 0.5) s - 0.5, per axis.
  for (const auto& [width, height] : {std::pair(320, 240), {641, 100}, {1, 1}, {2000, 1500}}) {
    const PinholeCamera resized = kVgaCamera.Resized(width, height);
    EXPECT_EQ(resized.width, width);
    EXPECT_EQ(resized.height, height);
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 1}}) {
      const Eigen::Vector2d before = kVgaCamera.Project(point), after = resized.Project(point);
      EXPECT_NEAR(after.x(), (before.x() + 0.5) * width / 640.0 - 0.5, 1e-9);
      EXPECT_NEAR(after.y(), (before.y() + 0.5) * height / 480.0 - 0.5, 1e-9);
    }
  }
}

TEST(PinholeCameraTest, HalvedSeesTheMeansOfTwoByTwoPixels) {
  // Pixel 0 of the halved image covers pixels 0 and 1, whose middle is 0.5: u -> (u - 0.5) / 2, whatever the size.
  for (const auto& [width, height] : {std::pair(640, 480), {641, 483}, {7, 2}}) {
    PinholeCamera camera = kVgaCamera;
    camera.width = width;
    camera.height = height;
    const PinholeCamera halved = camera.Halved();
    EXPECT_EQ(halved.width, width / 2);
    EXPECT_EQ(halved.height, height / 2);
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 1}}) {
      const Eigen::Vector2d before = camera.Project(point), after = halved.Project(point);
      EXPECT_NEAR(after.x(), (before.x() - 0.5) / 2, 1e-9);
      EXPECT_NEAR(after.y(), (before.y() - 0.5) / 2, 1e-9);
    }
  }
  // Where nothing is left out it is the camera of the resized image.
  const PinholeCamera halved = kVgaCamera.Halved(), resized = kVgaCamera.Resized(320, 240);
  EXPECT_NEAR(halved.cx, resized.cx, 1e-12);
  EXPECT_NEAR(halved.cy, resized.cy, 1e-12);
  EXPECT_EQ(halved.fx, resized.fx);
  EXPECT_EQ(halved.fy, resized.fy);
}

}  // namespace
}  // namespace acmp
