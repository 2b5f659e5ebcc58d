// Points that a frontend with a wrong convention sends: the check must say so, and nothing where all is right. And what
// poses are declared to be.

#include <limits>

#include "acmp_mapping/intake/convention_check.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "support/error_text.h"

namespace acmp {
namespace {

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
  EXPECT_THAT(Warnings(optical, optical, true, false), ElementsAre(HasAll("~sparse_frame: camera: 100 %", "set this")));
  EXPECT_THAT(Warnings(optical, optical, false, true), ElementsAre(HasSubstr("~sparse_frame: world: 100 %")));
  EXPECT_THAT(Warnings(body, optical), ElementsAre(HasAll("~pose_child", "T_body_cam")));
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

RigidTransform Shifted(double x, double y = 0, double z = 0) {
  RigidTransform transform = RigidTransform::Identity();
  transform.translation() << x, y, z;
  return transform;
}

TEST(PoseSemantics, AllConventionsDescribeOneCamera) {
  const RigidTransform flu = Shifted(1, 2, 3);  // looks along world x, with world z up
  RigidTransform optical = flu, body_from_cam = Shifted(0.1, -0.2, 0.3);
  optical.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  body_from_cam.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
  const std::tuple<Child, std::optional<RigidTransform>, RigidTransform> children[] = {
      {Child::kCameraOptical, {}, optical},
      {Child::kCameraFlu, {}, flu},
      {Child::kBody, body_from_cam, optical * body_from_cam.inverse()}};
  for (const auto& [child, extrinsic, world_from_child] : children) {
    for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
      const PoseSemantics semantics{direction, child, extrinsic};
      const bool inverted = direction == Direction::kCamFromWorld;
      // 1e-12: a few products of doubles near 1
      EXPECT_TRUE(
          WorldFromCamera(semantics, inverted ? world_from_child.inverse() : world_from_child).isApprox(optical, 1e-12))
          << Describe(semantics);
    }
  }
}

TEST(CheckedTransform, TakesAQuaternionOfNearlyUnitLengthAndNamesAnyOther) {
  const RigidTransform pose = CheckedTransform({1.0009, 0, 0, 0}, {1, 2, 3});
  EXPECT_TRUE(pose.linear().isIdentity(1e-12));
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(1, 2, 3));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::tuple<Eigen::Quaterniond, Eigen::Vector3d, const char*> bad[] = {
      {{1, 0, 0, 0}, {kNan, 0, 0}, "nan"},
      {{1, 0, 0, 0}, {0, INFINITY, 0}, "inf"},
      {{kNan, 0, 0, 0}, {0, 0, 0}, "not finite"},
      {{0, 0, 0, 0}, {0, 0, 0}, "norm is 0"},
      {{1.0011, 0, 0, 0}, {0, 0, 0}, "1.0011"}};
  for (const auto& [rotation, position, word] : bad) {
    EXPECT_THAT(ErrorOf([&, r = rotation, p = position] { CheckedTransform(r, p); }), HasSubstr(word));
  }
}

PoseSemantics Body(std::optional<RigidTransform> body_from_cam = std::nullopt) {
  return {Direction::kWorldFromCam, Child::kBody, body_from_cam};
}

/// Knows what is set, whatever the frames.
struct FakeTf {
  std::optional<RigidTransform> transform;
  std::string frames;  ///< of the last question
  TransformLookup lookup() {
    return [this](const std::string& target, const std::string& source) {
      frames = target + " " + source;
      return transform;
    };
  }
};

double CameraX(const PoseResolver& resolver) {
  return resolver.WorldFromCamera(RigidTransform::Identity()).translation().x();
}

TEST(PoseResolver, TheParameterCountsMostThenTfThenTheTopicAndTheSourceStays) {
  const struct {
    std::optional<RigidTransform> parameter, tf;
    const char* notice;
    double x, x_later;  // when tf has 20 and the topic 30
  } cases[] = {{Shifted(1), Shifted(2), "~T_body_cam", 1, 1},
               {{}, Shifted(2), "tf, \"imu\" to \"cam\"", 2, 20},
               {{}, {}, "topic extrinsic", 3, 30}};
  for (const auto& c : cases) {
    FakeTf tf{c.tf, ""};
    PoseResolver resolver(Body(c.parameter), false, tf.lookup());
    EXPECT_EQ(resolver.ready(), c.parameter.has_value());
    resolver.SetExtrinsic(Shifted(3));
    resolver.Update("imu", "cam");
    EXPECT_EQ(tf.frames, c.parameter ? "" : "imu cam");
    EXPECT_TRUE(resolver.ready());
    EXPECT_EQ(CameraX(resolver), c.x);
    EXPECT_THAT(*resolver.TakeNotice(), HasSubstr(c.notice));
    EXPECT_FALSE(resolver.TakeNotice()) << "once";
    tf.transform = Shifted(20);
    resolver.SetExtrinsic(Shifted(30));
    resolver.Update("imu", "cam");
    EXPECT_EQ(CameraX(resolver), c.x_later) << c.notice;
  }
  PoseResolver of_camera(PoseSemantics(), false, nullptr);
  of_camera.Update("", "");
  EXPECT_TRUE(of_camera.ready()) << "needs nothing";
  EXPECT_FALSE(of_camera.TakeNotice());
}

TEST(PoseResolver, LooksForWhatChecksMayTry) {
  FakeTf tf{Shifted(2), ""};
  PoseResolver resolver(PoseSemantics(), false, tf.lookup());
  resolver.Update("cam", "cam");
  EXPECT_FALSE(resolver.semantics().body_from_cam) << "there is no other frame";
  resolver.Update("imu", "cam");
  EXPECT_EQ(resolver.semantics().body_from_cam->translation().x(), 2);
  EXPECT_EQ(CameraX(resolver), 0) << "poses are read as declared";
  EXPECT_FALSE(resolver.TakeNotice());
}

TEST(PoseResolver, AnInvertedExtrinsicIsTurnedRound) {
  RigidTransform cam_from_body = Shifted(3);
  cam_from_body.rotate(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ()));
  PoseResolver resolver(Body(), true, nullptr);
  resolver.SetExtrinsic(cam_from_body);
  resolver.Update("", "");
  // 1e-12: an inverse of doubles near 1
  EXPECT_TRUE(resolver.WorldFromCamera(cam_from_body).isApprox(RigidTransform::Identity(), 1e-12));
  EXPECT_THAT(*resolver.TakeNotice(), HasSubstr("inverted"));
}

TEST(PoseResolver, SaysWhatWasLookedFor) {
  FakeTf tf;
  PoseResolver resolver(Body(), false, tf.lookup());
  resolver.Update("imu", "");
  EXPECT_THAT(resolver.DescribeMissing(), HasAll("~T_body_cam", "\"imu\"", "~camera_frame", "extrinsic"));
  EXPECT_EQ(tf.frames, "") << "nothing to ask for without both names";
}

}  // namespace
}  // namespace acmp
