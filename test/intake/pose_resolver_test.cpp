#include "acmp_mapping/intake/pose_resolver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

RigidTransform Shifted(double x) {
  RigidTransform transform = RigidTransform::Identity();
  transform.translation().x() = x;
  return transform;
}

PoseSemantics Body(std::optional<RigidTransform> body_from_cam = std::nullopt) {
  return {PoseSemantics::Direction::kWorldFromCam, PoseSemantics::Child::kBody, body_from_cam};
}

/// Knows what is set, whatever the frames.
struct FakeTf {
  std::optional<RigidTransform> transform;
  std::string target, source;
  TransformLookup lookup() {
    return [this](const std::string& t, const std::string& s) {
      target = t;
      source = s;
      return transform;
    };
  }
};

double CameraX(const PoseResolver& resolver) {
  return resolver.WorldFromCamera(RigidTransform::Identity()).translation().x();
}

TEST(PoseResolver, PosesOfTheCameraNeedNothing) {
  PoseResolver resolver(PoseSemantics(), false, nullptr);
  EXPECT_TRUE(resolver.ready());
  resolver.Update("", "");
  EXPECT_FALSE(resolver.TakeNotice());
}

TEST(PoseResolver, LooksForWhatChecksMayTry) {
  FakeTf tf{Shifted(2), {}, {}};
  PoseResolver resolver(PoseSemantics(), false, tf.lookup());
  resolver.Update("cam", "cam");
  EXPECT_FALSE(resolver.semantics().body_from_cam) << "there is no other frame";
  resolver.Update("imu", "cam");
  EXPECT_EQ(resolver.semantics().body_from_cam->translation().x(), 2);
  EXPECT_EQ(CameraX(resolver), 0) << "poses are read as declared";
  EXPECT_FALSE(resolver.TakeNotice());
}

TEST(PoseResolver, TheParameterCountsMost) {
  FakeTf tf{Shifted(2), {}, {}};
  PoseResolver resolver(Body(Shifted(1)), false, tf.lookup());
  resolver.SetExtrinsic(Shifted(3));
  resolver.Update("imu", "cam");
  EXPECT_EQ(CameraX(resolver), 1);
  EXPECT_THAT(*resolver.TakeNotice(), HasSubstr("~T_body_cam"));
  EXPECT_FALSE(resolver.TakeNotice()) << "once";
}

TEST(PoseResolver, ThenTfThenTheTopic) {
  FakeTf tf{Shifted(2), {}, {}};
  PoseResolver resolver(Body(), false, tf.lookup());
  EXPECT_FALSE(resolver.ready());
  resolver.SetExtrinsic(Shifted(3));
  resolver.Update("imu", "cam");
  EXPECT_EQ(tf.target, "imu");
  EXPECT_EQ(tf.source, "cam");
  EXPECT_EQ(CameraX(resolver), 2);
  EXPECT_THAT(*resolver.TakeNotice(), AllOf(HasSubstr("tf"), HasSubstr("imu"), HasSubstr("cam")));

  FakeTf unconnected;
  PoseResolver from_topic(Body(), false, unconnected.lookup());
  from_topic.Update("imu", "cam");
  EXPECT_FALSE(from_topic.ready());
  from_topic.SetExtrinsic(Shifted(3));
  from_topic.Update("imu", "cam");
  EXPECT_EQ(CameraX(from_topic), 3);
  EXPECT_THAT(*from_topic.TakeNotice(), HasSubstr("topic extrinsic"));
}

TEST(PoseResolver, TheSourceStaysAndItsLatestValueCounts) {
  FakeTf tf;
  PoseResolver resolver(Body(), false, tf.lookup());
  resolver.SetExtrinsic(Shifted(3));
  resolver.Update("imu", "cam");
  tf.transform = Shifted(2);
  resolver.SetExtrinsic(Shifted(4));
  resolver.Update("imu", "cam");
  EXPECT_EQ(CameraX(resolver), 4);
  FakeTf moving{Shifted(2), {}, {}};
  PoseResolver from_tf(Body(), false, moving.lookup());
  from_tf.Update("imu", "cam");
  moving.transform = Shifted(5);
  from_tf.Update("imu", "cam");
  EXPECT_EQ(CameraX(from_tf), 5);
}

TEST(PoseResolver, AnInvertedExtrinsicIsTurnedRound) {
  RigidTransform cam_from_body = Shifted(3);
  cam_from_body.linear() = Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ()).toRotationMatrix();
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
  EXPECT_EQ(tf.target, "") << "nothing to ask for without both names";
}

}  // namespace
}  // namespace acmp
