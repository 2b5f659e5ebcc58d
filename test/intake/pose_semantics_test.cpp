#include "acmp_mapping/intake/pose_semantics.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Direction = PoseSemantics::Direction;
using Child = PoseSemantics::Child;

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
  EXPECT_THAT(resolver.DescribeMissing(), AllOf(HasSubstr("~T_body_cam"), HasSubstr("\"imu\""),
                                                HasSubstr("~camera_frame"), HasSubstr("extrinsic")));
  EXPECT_EQ(tf.frames, "") << "nothing to ask for without both names";
}

}  // namespace
}  // namespace acmp
