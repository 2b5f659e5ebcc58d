#include "acmp_mapping/intake/keyframe_gate.h"

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

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
    KeyframeGate gate;  // 0.05
    EXPECT_TRUE(gate.Accept(At(0), 2 * scale));
    EXPECT_FALSE(gate.Accept(At(0.099 * scale), 2 * scale));
    EXPECT_TRUE(gate.Accept(At(0.101 * scale), 2 * scale));
    EXPECT_FALSE(gate.Accept(At(0.199 * scale), 2 * scale)) << "compared with the last keyframe";
  }
}

TEST(KeyframeGate, AcceptsRotation) {
  KeyframeGate gate;
  EXPECT_TRUE(gate.Accept(At(0, 0), 2));
  EXPECT_FALSE(gate.Accept(At(0, 9.9), 2));
  EXPECT_TRUE(gate.Accept(At(0, 10.1), 2));
  gate.set_options({0.05, 5});
  EXPECT_TRUE(gate.Accept(At(0, 15.2), 2));
}

TEST(KeyframeGate, TakesEveryMovedPoseWhileTheDepthIsUnknown) {
  KeyframeGate gate;
  EXPECT_TRUE(gate.Accept(At(0), 0));
  EXPECT_TRUE(gate.Accept(At(1e-3), 0));
  EXPECT_FALSE(gate.Accept(At(1e-3), 0)) << "standing still";
}

TEST(KeyframeGate, StartsAgainAfterReset) {
  KeyframeGate gate;
  EXPECT_TRUE(gate.Accept(At(0), 2));
  EXPECT_FALSE(gate.Accept(At(0), 2));
  gate.Reset();
  EXPECT_TRUE(gate.Accept(At(0), 2));
}

TEST(KeyframeGate, RefusesBadOptions) {
  EXPECT_THROW(Validate(KeyframeGateOptions{-0.1, 10}), InvalidInputError);
  EXPECT_THROW(Validate(KeyframeGateOptions{0.1, 0}), InvalidInputError);
}

}  // namespace
}  // namespace acmp
