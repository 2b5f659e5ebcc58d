// Feeds the check what a frontend with a wrong convention sends: it must name the right one.

#include "acmp_mapping/intake/convention_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Direction = PoseSemantics::Direction;
using Child = PoseSemantics::Child;

PinholeCamera TestCamera() {
  PinholeCamera camera;
  camera.width = 64;
  camera.height = 48;
  camera.fx = camera.fy = 50;
  camera.cx = 31.5;
  camera.cy = 23.5;
  return camera;
}

/// A level camera that moves and turns, so that no wrong reading fits all keyframes by chance. World z is up.
RigidTransform TrueWorldFromCam(int i) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;  // looks along world x
  world_from_cam.prerotate(Eigen::AngleAxisd(1.1 * i, Eigen::Vector3d::UnitZ()));
  world_from_cam.translation() = Eigen::Vector3d(5 + i, 3 - 2 * i, 1);
  return world_from_cam;
}

/// Points of a wall 4 before the camera, seen in the image, in the world.
SparseCloud TrueCloud(int i) {
  SparseCloud cloud;
  for (int k = -10; k <= 10; ++k) cloud.points.push_back(TrueWorldFromCam(i) * Eigen::Vector3d(0.1 * k, 0.05 * k, 4));
  return cloud;
}

/// The pose that must be sent for these semantics to give the true one.
RigidTransform Sent(const PoseSemantics& semantics, const RigidTransform& world_from_cam) {
  RigidTransform cam_from_child = RigidTransform::Identity();
  if (semantics.child != Child::kCameraOptical) {
    cam_from_child = WorldFromCamera({Direction::kWorldFromCam, semantics.child, semantics.body_from_cam},
                                     RigidTransform::Identity())
                         .inverse();
  }
  const RigidTransform world_from_child = world_from_cam * cam_from_child;
  return semantics.direction == Direction::kWorldFromCam ? world_from_child : world_from_child.inverse();
}

/// The warnings for five keyframes that are sent in one way and read in another.
std::vector<std::string> Warnings(const PoseSemantics& sent, const PoseSemantics& configured,
                                  bool points_in_camera = false, bool read_in_camera = false) {
  ConventionCheck check;
  EXPECT_FALSE(check.share_in_front());
  std::vector<std::string> warnings;
  for (int i = 0; i < 3 * ConventionCheck::kKeyframes; ++i) {
    SparseCloud cloud = TrueCloud(i);
    if (points_in_camera) {
      for (Eigen::Vector3d& point : cloud.points) point = TrueWorldFromCam(i).inverse() * point;
    }
    const RigidTransform received = Sent(sent, TrueWorldFromCam(i));
    EXPECT_FALSE(check.Add(configured, received, SparseCloud(), read_in_camera, TestCamera())) << "tells nothing";
    if (auto warning = check.Add(configured, received, cloud, read_in_camera, TestCamera()))
      warnings.push_back(*warning);
  }
  EXPECT_TRUE(check.share_in_front());
  return warnings;
}

TEST(ConventionCheck, IsSilentWhenTheConventionIsRight) {
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    for (const Child child : {Child::kCameraOptical, Child::kCameraFlu}) {
      const PoseSemantics semantics{direction, child, std::nullopt};
      EXPECT_TRUE(Warnings(semantics, semantics).empty()) << Describe(semantics);
    }
  }
  EXPECT_TRUE(Warnings({}, {}, true, true).empty());
}

TEST(ConventionCheck, NamesTheConventionThatFits) {
  const PoseSemantics optical, inverted{Direction::kCamFromWorld, Child::kCameraOptical, std::nullopt},
      flu{Direction::kWorldFromCam, Child::kCameraFlu, std::nullopt};
  auto warnings = Warnings(inverted, optical);
  ASSERT_EQ(warnings.size(), 1u) << "once";
  EXPECT_THAT(warnings[0], AllOf(HasSubstr("~pose_is: T_cam_world"), HasSubstr("~pose_child: camera_optical"),
                                 HasSubstr("set this"), HasSubstr("100 %")));
  warnings = Warnings(flu, optical);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], AllOf(HasSubstr("~pose_is: T_world_cam"), HasSubstr("~pose_child: camera_flu")));
  warnings = Warnings(optical, flu);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("~pose_child: camera_optical"));
}

/// A level camera that moves sideways past a wall, as recordings begin: near the world's origin and hardly turned, so
/// that many points lie in the image with the inverse pose, too.
std::vector<std::string> WarningsNearTheOrigin(Direction sent, Direction configured, double step) {
  ConventionCheck check;
  std::vector<std::string> warnings;
  for (int i = 0; i < ConventionCheck::kLastKeyframes + 5; ++i) {
    RigidTransform world_from_cam = RigidTransform::Identity();
    world_from_cam.translation() = Eigen::Vector3d(step * i, 0, 0);
    SparseCloud cloud;
    for (int k = -20; k <= 20; ++k) cloud.points.push_back(world_from_cam * Eigen::Vector3d(0.1 * k, 0.02 * k, 4));
    const RigidTransform received = Sent({sent, Child::kCameraOptical, std::nullopt}, world_from_cam);
    const PoseSemantics read{configured, Child::kCameraOptical, std::nullopt};
    if (auto warning = check.Add(read, received, cloud, false, TestCamera())) warnings.push_back(*warning);
  }
  EXPECT_EQ(warnings.empty() ? "" : warnings[0], check.warning());
  return warnings;
}

TEST(ConventionCheck, ComparesReadingsWithEachOther) {
  // The wrong reading has half of the points in the image at first: 5 keyframes are shifted by 0 to 2.8 times 2.
  auto warnings = WarningsNearTheOrigin(Direction::kCamFromWorld, Direction::kWorldFromCam, 0.45);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0],
              AllOf(HasSubstr("first 5 keyframes"), HasSubstr("100 % lie in front of the camera and only "),
                    HasSubstr("~pose_is: T_cam_world"), HasSubstr("set this")));
  // Slower: it shows only later.
  warnings = WarningsNearTheOrigin(Direction::kWorldFromCam, Direction::kCamFromWorld, 0.05);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], AllOf(HasSubstr("first 40 keyframes"), HasSubstr("~pose_is: T_world_cam")));
  EXPECT_TRUE(WarningsNearTheOrigin(Direction::kWorldFromCam, Direction::kWorldFromCam, 0.45).empty());
}

TEST(ConventionCheck, NamesAnInvertedExtrinsic) {
  RigidTransform body_from_cam = RigidTransform::Identity();  // a camera that looks sideways from its body
  body_from_cam.linear() = Eigen::AngleAxisd(1.2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const PoseSemantics sent{Direction::kWorldFromCam, Child::kBody, body_from_cam};
  PoseSemantics configured = sent;
  configured.body_from_cam = body_from_cam.inverse();
  const auto warnings = Warnings(sent, configured);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("T_body_cam inverted"));
}

TEST(ConventionCheck, NamesTheFrameOfThePoints) {
  auto warnings = Warnings({}, {}, true, false);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("~sparse_frame: camera"));
  warnings = Warnings({}, {}, false, true);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("~sparse_frame: world"));
}

TEST(ConventionCheck, AdmitsThatNothingFits) {
  RigidTransform odd = RigidTransform::Identity();  // a body whose transform to the camera nobody has told
  odd.linear() = Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, 0.3, 0).normalized()).toRotationMatrix();
  const auto warnings = Warnings({Direction::kWorldFromCam, Child::kBody, odd}, {});
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], AllOf(HasSubstr("no other reading"), HasSubstr("T_body_cam")));
}

}  // namespace
}  // namespace acmp
