#include "acmp_mapping/intake/pose_semantics.h"

#include <limits>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Camera at (1, 2, 3) that looks along world x, with world z up: optical z = x, optical x = -y, optical y = -z.
RigidTransform WorldFromOptical() {
  RigidTransform pose = RigidTransform::Identity();
  pose.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  pose.translation() << 1, 2, 3;
  return pose;
}

/// The same camera with FLU axes, which are the world's here.
RigidTransform WorldFromFlu() {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 1, 2, 3;
  return pose;
}

TEST(PoseSemantics, AllConventionsDescribeOneCamera) {
  using Direction = PoseSemantics::Direction;
  using Child = PoseSemantics::Child;
  RigidTransform body_from_cam = RigidTransform::Identity();
  body_from_cam.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  body_from_cam.translation() << 0.1, -0.2, 0.3;
  const struct {
    PoseSemantics semantics;
    RigidTransform received;
  } cases[] = {
      {{Direction::kWorldFromCam, Child::kCameraOptical, {}}, WorldFromOptical()},
      {{Direction::kCamFromWorld, Child::kCameraOptical, {}}, WorldFromOptical().inverse()},
      {{Direction::kWorldFromCam, Child::kCameraFlu, {}}, WorldFromFlu()},
      {{Direction::kCamFromWorld, Child::kCameraFlu, {}}, WorldFromFlu().inverse()},
      {{Direction::kWorldFromCam, Child::kBody, body_from_cam}, WorldFromOptical() * body_from_cam.inverse()},
      {{Direction::kCamFromWorld, Child::kBody, body_from_cam}, body_from_cam * WorldFromOptical().inverse()},
  };
  for (const auto& c : cases) {
    // 1e-12: a few products of doubles near 1
    EXPECT_TRUE(WorldFromCamera(c.semantics, c.received).isApprox(WorldFromOptical(), 1e-12)) << Describe(c.semantics);
  }
}

std::string Refusal(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& position) {
  try {
    CheckedTransform(rotation, position);
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "";
}

TEST(CheckedTransform, RefusesWhatIsNoPoseAndNamesTheValue) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  EXPECT_NE(Refusal({1, 0, 0, 0}, {nan, 0, 0}).find("nan"), std::string::npos);
  EXPECT_NE(Refusal({1, 0, 0, 0}, {0, std::numeric_limits<double>::infinity(), 0}).find("inf"), std::string::npos);
  EXPECT_NE(Refusal({nan, 0, 0, 0}, origin).find("not finite"), std::string::npos);
  EXPECT_NE(Refusal({0, 0, 0, 0}, origin).find("norm is 0"), std::string::npos);
  EXPECT_NE(Refusal({1.0011, 0, 0, 0}, origin).find("1.0011"), std::string::npos);
  EXPECT_EQ(Refusal({1.0009, 0, 0, 0}, origin), "");
}

TEST(CheckedTransform, NormalisesSmallErrors) {
  const RigidTransform pose = CheckedTransform({1.0009, 0, 0, 0}, {1, 2, 3});
  EXPECT_TRUE(pose.linear().isIdentity(1e-12));
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(1, 2, 3));
}

}  // namespace
}  // namespace acmp
