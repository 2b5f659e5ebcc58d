#include "acmp_mapping/keyframe/depth_range.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "keyframe/small_camera.h"

namespace acmp {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// 101 points on the optical axis at depths 1.00, 1.01, ..., 2.00 of a camera that looks along world x.
struct AxisScene {
  AxisScene() {
    Eigen::Matrix3d cam_from_world;
    cam_from_world << 0, -1, 0, 0, 0, -1, 1, 0, 0;  // x right = -y, y down = -z, z forward = x
    pose.linear() = cam_from_world;
    pose.translation() = -cam_from_world * Eigen::Vector3d(5, 6, 7);
    for (int i = 100; i >= 0; --i) points.push_back(AtDepth(1.0 + 0.01 * i));
  }
  Eigen::Vector3d AtDepth(double depth) const { return {5 + depth, 6, 7}; }

  RigidTransform pose = RigidTransform::Identity();
  std::vector<Eigen::Vector3d> points;
};

TEST(DepthRangeTest, TakesQuantilesWithMargin) {
  const AxisScene scene;
  const auto range = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  ASSERT_TRUE(range);
  // Of 101 sorted depths 2 % lie below 1.02 and above 1.98; the result is a float.
  EXPECT_NEAR(range->min, 1.02 / kDepthMargin, 1e-6);
  EXPECT_NEAR(range->max, 1.98 * kDepthMargin, 1e-6);
}

TEST(DepthRangeTest, IgnoresWhatIsNotALandmarkInView) {
  AxisScene scene;
  const auto expected = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  // (0, 0, 0) is in front of this camera, so only the rule about exact zeros keeps it out.
  scene.pose.translation() += Eigen::Vector3d(0, 0, 100);
  for (auto& point : scene.points) point.x() -= 100;
  for (int i = 0; i < 200; ++i) {
    scene.points.insert(scene.points.end(), {{kNan, 1, 1},
                                             {1, kInf, 1},
                                             {1, 1, -kInf},
                                             {0, 0, 0},
                                             scene.AtDepth(-100.0 - i),  // the camera's centre: z = -i
                                             {scene.points[0].x(), 6 + 0.02 * i + 2, 7},
                                             {scene.points[0].x(), 6, 7 - 0.02 * i - 2}});
  }
  const auto range = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  ASSERT_TRUE(range);
  EXPECT_FLOAT_EQ(range->min, expected->min);
  EXPECT_FLOAT_EQ(range->max, expected->max);
}

TEST(DepthRangeTest, NoneWithTooFewLandmarks) {
  const AxisScene scene;
  EXPECT_FALSE(DepthRangeFromLandmarks({}, kSmallCamera, scene.pose));
  const std::vector<Eigen::Vector3d> nine(scene.points.begin(), scene.points.begin() + 9);
  EXPECT_FALSE(DepthRangeFromLandmarks(nine, kSmallCamera, scene.pose));
  const std::vector<Eigen::Vector3d> ten(scene.points.begin(), scene.points.begin() + 10);
  EXPECT_TRUE(DepthRangeFromLandmarks(ten, kSmallCamera, scene.pose));
}

}  // namespace
}  // namespace acmp
