#include "acmp_mapping/intake/keyframe_gate.h"

#include <cmath>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "intake/samples.h"

namespace acmp {
namespace {

RigidTransform At(double x, double angle_deg = 0) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation().x() = x;
  pose.linear() = Eigen::AngleAxisd(angle_deg * M_PI / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return pose;
}

TEST(KeyframeGate, ComparesBaselineWithDepthWhateverTheScale) {
  for (const double scale : {0.01, 1.0, 1000.0}) {
    KeyframeGate gate;  // 0.02
    EXPECT_TRUE(gate.Accept(At(0), kVgaCamera, 5 * scale));
    EXPECT_FALSE(gate.Accept(At(0.099 * scale), kVgaCamera, 5 * scale));
    EXPECT_TRUE(gate.Accept(At(0.101 * scale), kVgaCamera, 5 * scale));
    EXPECT_FALSE(gate.Accept(At(0.199 * scale), kVgaCamera, 5 * scale)) << "compared with the last keyframe";
  }
}

TEST(KeyframeGate, RotationAloneIsNoKeyframe) {
  KeyframeGate gate;
  EXPECT_TRUE(gate.Accept(At(0, 0), kVgaCamera, 2));
  for (int angle = 0; angle < 360; angle += 5) EXPECT_FALSE(gate.Accept(At(0, angle), kVgaCamera, 2));
  EXPECT_TRUE(gate.Accept(At(0.05, 180), kVgaCamera, 2)) << "moved, after the turn";
}

TEST(KeyframeGate, ACameraThatStandsAndSwaysChangesNothing) {
  KeyframeGate gate;
  const auto sway = [&](int i) {
    return gate.Accept(At(0.1 * std::sin(0.7 * i), 3 * std::cos(0.9 * i)), kVgaCamera, 2);
  };
  int accepted = 0;
  for (int i = 0; i < 100; ++i) accepted += sway(i);
  EXPECT_LE(accepted, 6) << "one per 4 cm";
  for (int i = 100; i < 18000; ++i) EXPECT_FALSE(sway(i)) << i;
}

TEST(KeyframeGate, TheWayBackWithAnotherViewIsNew) {
  KeyframeGate gate;
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(gate.Accept(At(0.1 * i), kVgaCamera, 2));
  for (int i = 8; i >= 0; --i) EXPECT_FALSE(gate.Accept(At(0.1 * i), kVgaCamera, 2)) << "the same again";
  for (int i = 8; i >= 0; --i) EXPECT_TRUE(gate.Accept(At(0.1 * i, 90), kVgaCamera, 2)) << "looking aside";
}

TEST(KeyframeGate, ForgetsWhatTheWindowForgets) {
  KeyframeGate gate;
  gate.set_options({0.02, 3});
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(gate.Accept(At(i), kVgaCamera, 2));
  EXPECT_FALSE(gate.Accept(At(2), kVgaCamera, 2));
  EXPECT_TRUE(gate.Accept(At(0), kVgaCamera, 2));
}

TEST(KeyframeGate, TakesEveryMovedPoseWhileTheDepthIsUnknownAndBeginsAgainAfterReset) {
  KeyframeGate gate;
  EXPECT_TRUE(gate.Accept(At(0), kVgaCamera, 0));
  EXPECT_TRUE(gate.Accept(At(1e-3), kVgaCamera, 0));
  EXPECT_FALSE(gate.Accept(At(1e-3), kVgaCamera, 0)) << "standing still";
  gate.Reset();
  EXPECT_TRUE(gate.Accept(At(1e-3), kVgaCamera, 0));
}

}  // namespace
}  // namespace acmp
