// Feeds the check what a frontend with a wrong convention sends: it must name the right one.

#include "acmp_mapping/intake/convention_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
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
  for (int i = 0; i < 3 * ConventionCheck::kLooks; ++i) {
    SparseCloud cloud = TrueCloud(i);
    if (points_in_camera) {
      for (Eigen::Vector3d& point : cloud.points) point = TrueWorldFromCam(i).inverse() * point;
    }
    const RigidTransform received = Sent(sent, TrueWorldFromCam(i));
    EXPECT_FALSE(check.Add(configured, received, SparseCloud(), read_in_camera, kCamera)) << "tells nothing";
    if (auto warning = check.Add(configured, received, cloud, read_in_camera, kCamera)) warnings.push_back(*warning);
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

TEST(ConventionCheck, NamesTheReadingThatFitsOnce) {
  const PoseSemantics optical, inverted{Direction::kCamFromWorld, Child::kCameraOptical, std::nullopt},
      flu{Direction::kWorldFromCam, Child::kCameraFlu, std::nullopt};
  RigidTransform sideways(Eigen::AngleAxisd(1.2, Eigen::Vector3d::UnitY()));  // a camera that looks so from its body
  RigidTransform odd(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, 0.3, 0).normalized()));  // that nobody has told
  const PoseSemantics body{Direction::kWorldFromCam, Child::kBody, sideways},
      body_inverted{Direction::kWorldFromCam, Child::kBody, sideways.inverse()},
      untold{Direction::kWorldFromCam, Child::kBody, odd};
  const struct {
    PoseSemantics sent, configured;
    bool points_in_camera, read_in_camera;
    std::vector<std::string> words;
  } cases[] = {
      {inverted, optical, false, false, {"~pose_is: T_cam_world, ~pose_child: camera_optical", "set this", "100 %"}},
      {flu, optical, false, false, {"~pose_is: T_world_cam, ~pose_child: camera_flu"}},
      {optical, flu, false, false, {"~pose_child: camera_optical"}},
      {body, body_inverted, false, false, {"the inverse of T_body_cam"}},
      {optical, optical, true, false, {"~sparse_frame: camera"}},
      {optical, optical, false, true, {"~sparse_frame: world"}},
      {untold, optical, false, false, {"no other reading", "T_body_cam"}}};
  for (const auto& c : cases) {
    const auto warnings = Warnings(c.sent, c.configured, c.points_in_camera, c.read_in_camera);
    ASSERT_EQ(warnings.size(), 1u) << c.words[0];
    for (const std::string& word : c.words) EXPECT_THAT(warnings[0], HasSubstr(word));
  }
}

/// What a frontend sends that begins at the world's origin and sends its whole map: keyframe i adds points that it
/// sees, and moves all of them a little. `first`: what comes before is not recorded.
std::vector<std::string> WarningsOfAGrowingMap(const PoseSemantics& sent, const PoseSemantics& configured, int first) {
  ConventionCheck check;
  std::vector<std::string> warnings;
  SparseCloud map;
  for (int i = 0; i < 60; ++i) {
    RigidTransform world_from_cam(Eigen::AngleAxisd(0.03 * i, Eigen::Vector3d::UnitY()));
    world_from_cam.translation() = Eigen::Vector3d(0.2 * i, -0.05 * i, 0.3 * i);
    for (int k = -10; k < 10; ++k) {
      map.points.push_back(world_from_cam *
                           Eigen::Vector3d(0.13 * k, 0.06 * ((k * 7 + i) % 20 - 10), 4 + 0.1 * (k % 3)));
    }
    for (Eigen::Vector3d& point : map.points) point *= 1.0003;
    if (i < first) continue;
    if (auto warning = check.Add(configured, Sent(sent, world_from_cam), map, false, kCamera)) {
      warnings.push_back(*warning);
    }
  }
  EXPECT_EQ(warnings.empty() ? "" : warnings.back(), check.warning());
  return warnings;
}

TEST(ConventionCheck, NeverOrdersAWrongReadingOfAMapThatGrows) {
  std::vector<PoseSemantics> readings;
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    for (const Child child : {Child::kCameraOptical, Child::kCameraFlu}) readings.push_back({direction, child, {}});
  }
  for (const PoseSemantics& sent : readings) {
    for (const PoseSemantics& configured : readings) {
      const std::string what = Describe(sent) + " read as " + Describe(configured);
      for (const int first : {0, 20}) {
        const auto warnings = WarningsOfAGrowingMap(sent, configured, first);
        if (Describe(sent) == Describe(configured)) {
          EXPECT_TRUE(warnings.empty()) << what << ": " << warnings.front();
          continue;
        }
        ASSERT_FALSE(warnings.empty()) << what;
        EXPECT_THAT(warnings.back(), AllOf(HasSubstr("set this"), HasSubstr(Concat("~pose_is: ", Name(sent.direction))),
                                           HasSubstr(Concat("~pose_child: ", Name(sent.child)))))
            << what;
        if (warnings.size() == 1) continue;
        EXPECT_EQ(warnings.size(), 2u);
        EXPECT_THAT(warnings.front(), AllOf(HasSubstr("several other readings fit"), Not(HasSubstr("set this"))));
      }
    }
  }
  // At the start the inverse pose and the camera's own frame fit nearly as well.
  EXPECT_EQ(WarningsOfAGrowingMap({}, {Direction::kWorldFromCam, Child::kCameraFlu, std::nullopt}, 0).size(), 2u);
}

}  // namespace
}  // namespace acmp
