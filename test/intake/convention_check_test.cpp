// Points that a frontend with a wrong convention sends: the check must say so, and nothing where all is right.

#include "acmp_mapping/intake/convention_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Direction = PoseSemantics::Direction;
using Child = PoseSemantics::Child;

constexpr PinholeCamera kCamera = {64, 48, 50, 50, 31.5, 23.5};

/// A level camera that moves and turns, so that no wrong reading fits all keyframes by chance. World z is up.
RigidTransform TrueWorldFromCam(int i) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;  // looks along world x
  world_from_cam.prerotate(Eigen::AngleAxisd(1.1 * i, Eigen::Vector3d::UnitZ()));
  world_from_cam.translation() = Eigen::Vector3d(5 + i, 3 - 2 * i, 1);
  return world_from_cam;
}

/// Points of a wall some 4 before the camera, others each time, seen in the image, in the world.
SparseCloud TrueCloud(int i) {
  SparseCloud cloud;
  for (int k = -10; k <= 10; ++k) {
    cloud.points.push_back(TrueWorldFromCam(i) * Eigen::Vector3d(0.1 * k, 0.05 * k, 4 + 0.17 * (i % 5)));
  }
  return cloud;
}

/// The pose that must be sent for these semantics to give the true one.
RigidTransform Sent(const PoseSemantics& semantics, const RigidTransform& world_from_cam) {
  const RigidTransform world_from_child = world_from_cam * ChildFromCamera(semantics).inverse();
  return semantics.direction == Direction::kWorldFromCam ? world_from_child : world_from_child.inverse();
}

/// The warnings for keyframes that are sent in one way and read in another.
std::vector<std::string> Warnings(const PoseSemantics& sent, const PoseSemantics& configured,
                                  bool points_in_camera = false, bool read_in_camera = false) {
  ConventionCheck check;
  EXPECT_FALSE(check.share_in_front());
  std::vector<std::string> warnings;
  for (int i = 0; i < 15; ++i) {
    SparseCloud cloud = TrueCloud(i);
    if (points_in_camera) {
      for (Eigen::Vector3d& point : cloud.points) point = TrueWorldFromCam(i).inverse() * point;
    }
    const RigidTransform received = Sent(sent, TrueWorldFromCam(i));
    EXPECT_FALSE(check.Add(configured, received, SparseCloud(), read_in_camera, kCamera)) << "tells nothing";
    if (auto warning = check.Add(configured, received, cloud, read_in_camera, kCamera)) warnings.push_back(*warning);
  }
  EXPECT_TRUE(check.share_in_front());
  EXPECT_EQ(warnings.empty() ? "" : warnings.back(), check.warning());
  return warnings;
}

TEST(ConventionCheck, WarnsOnceOfTheOtherFrameOrOfPosesThatPutNothingInView) {
  const PoseSemantics optical, flu{Direction::kWorldFromCam, Child::kCameraFlu, std::nullopt};
  RigidTransform odd(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, 0.3, 0).normalized()));  // that nobody has told
  const PoseSemantics body{Direction::kWorldFromCam, Child::kBody, odd};
  EXPECT_THAT(Warnings(optical, optical, true, false),
              ElementsAre(AllOf(HasSubstr("~sparse_frame: camera: 100 %"), HasSubstr("set this"))));
  EXPECT_THAT(Warnings(optical, optical, false, true), ElementsAre(HasSubstr("~sparse_frame: world: 100 %")));
  EXPECT_THAT(Warnings(body, optical), ElementsAre(AllOf(HasSubstr("~pose_child"), HasSubstr("T_body_cam"))));
  for (const PoseSemantics& semantics : {optical, flu}) EXPECT_THAT(Warnings(semantics, semantics), IsEmpty());
  EXPECT_THAT(Warnings(optical, optical, true, true), IsEmpty());
}

/// What a frontend sends that begins at the world's origin and sends its whole map: keyframe i adds points that it
/// sees, and moves all of them a little. Most of them lie outside of the image.
TEST(ConventionCheck, LooksAtThePointsThatAreNewInAMap) {
  ConventionCheck check;
  SparseCloud map;
  for (int i = 0; i < 60; ++i) {
    RigidTransform world_from_cam(Eigen::AngleAxisd(0.03 * i, Eigen::Vector3d::UnitY()));
    world_from_cam.translation() = Eigen::Vector3d(0.2 * i, -0.05 * i, 0.3 * i);
    for (int k = -10; k < 10; ++k) {
      map.points.push_back(world_from_cam *
                           Eigen::Vector3d(0.13 * k, 0.06 * ((k * 7 + i) % 20 - 10), 4 + 0.1 * (k % 3)));
    }
    for (Eigen::Vector3d& point : map.points) point *= 1.0003;
    EXPECT_FALSE(check.Add({}, world_from_cam, map, false, kCamera)) << i;
  }
  EXPECT_LT(*check.share_in_front(), 0.9);
}

}  // namespace
}  // namespace acmp
