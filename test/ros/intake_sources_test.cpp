// What the intake takes besides plain topics: transforms that are looked up, an extrinsic that comes late, keyframes in
// one message.

#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "ros/intake_support.h"

namespace acmp::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int64_t kSecond = 1000000000;

/// tf as far as it has come: poses by stamp.
struct FakeTf {
  std::map<int64_t, double> x;
  std::optional<RigidTransform> body_from_cam;
  std::string world, child;

  TransformSource source() {
    TransformSource source;
    source.find_pose = [this](const std::string& w, const std::string& c,
                              int64_t stamp_ns) -> std::variant<PoseSample, std::string> {
      world = w;
      child = c;
      if (x.count(stamp_ns) == 0) return "tf has no \"" + c + "\" in \"" + w + "\" then";
      PoseSample pose = PoseAt(static_cast<uint32_t>(stamp_ns / kSecond), x.at(stamp_ns), w);
      pose.child_frame = c;
      return pose;
    };
    source.find_latest = [this](const std::string&, const std::string&) { return body_from_cam; };
    return source;
  }
};

NodeOptions TfOptions() {
  NodeOptions options;
  options.pose_source = PoseSource::kTf;
  options.world_frame = "map";
  return options;
}

TEST(IntakeFromTf, ImagesWaitUntilTheirTransformHasCome) {
  FakeTf tf;
  KeyframeIntake intake(TfOptions(), {}, 0, tf.source());
  intake.set_clouds_expected(false);
  intake.AddCameraInfo(MakeInfo());
  intake.AddImage(ImageAt(5, "/left"));
  EXPECT_THAT(Split(intake.Take(0)).keyframes, IsEmpty());
  EXPECT_EQ(tf.world, "map");
  EXPECT_EQ(tf.child, "left");
  tf.x[5 * kSecond] = 1.5;
  const Result result = Split(intake.Take(0));
  ASSERT_EQ(result.keyframes.size(), 1u);
  EXPECT_EQ(result.keyframes[0].world_from_cam.translation().x(), 1.5);
  EXPECT_EQ(result.keyframes[0].world_frame, "map");
}

TEST(IntakeFromTf, DroppedImagesSayWhatTfLacks) {
  NodeOptions options = TfOptions();
  options.camera_frame = "optical";
  options.matcher.image_capacity = 1;
  FakeTf tf;
  KeyframeIntake intake(options, {}, 0, tf.source());
  intake.AddCameraInfo(MakeInfo());
  intake.AddImage(ImageAt(5));
  intake.Take(0);
  intake.AddImage(ImageAt(6));
  const Result result = Split(intake.Take(0));
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_EQ(result.drops[0].reason, "no_pose");
  EXPECT_THAT(result.drops[0].message, HasSubstr("tf has no \"optical\" in \"map\""));
  EXPECT_THAT(intake.last_gap()->problem, HasSubstr("optical"));
}

TEST(IntakeFromTf, ImagesWithoutAFrameNeedOneToBeSet) {
  FakeTf tf;
  NodeOptions options = TfOptions();
  options.matcher.image_capacity = 1;
  KeyframeIntake intake(options, {}, 0, tf.source());
  intake.AddCameraInfo(MakeInfo(""));
  intake.AddImage(ImageAt(5, ""));
  intake.Take(0);
  intake.AddImage(ImageAt(6, ""));
  EXPECT_THAT(Split(intake.Take(0)).drops.at(0).message, HasSubstr("~camera_frame"));
}

TEST(IntakeFromOdometry, ADoubtAboutPosesNamesTheirFrame) {
  KeyframeIntake intake({}, {}, 0, {});
  intake.AddImage(ImageAt(5, "cam0_optical"));
  PoseSample pose = PoseAt(5, 0);
  intake.AddPose(pose);
  EXPECT_EQ(intake.DescribeDoubt(), "") << "PoseStamped names no frame";
  pose.child_frame = "imu";
  intake.AddPose(pose);
  EXPECT_THAT(intake.DescribeDoubt(),
              AllOf(HasSubstr("\"imu\""), HasSubstr("\"cam0_optical\""), HasSubstr("set ~pose_child: body")));
  pose.child_frame = "cam0_optical";
  intake.AddPose(pose);
  EXPECT_EQ(intake.DescribeDoubt(), "");
  NodeOptions body;
  body.pose.child = PoseSemantics::Child::kBody;
  EXPECT_THAT(KeyframeIntake(body, {}, 0, {}).DescribeDoubt(), HasSubstr("~extrinsic_inverted"));
}

NodeOptions BodyOptions() {
  NodeOptions options;
  options.pose.child = PoseSemantics::Child::kBody;
  return options;
}

TEST(IntakeFromTf, SaysWhatImagesWaitForBeforeAnyIsDropped) {
  FakeTf tf;
  KeyframeIntake intake(TfOptions(), {}, 0, tf.source());
  intake.set_clouds_expected(false);
  EXPECT_EQ(intake.DescribeWait(100), "") << "no image, no wait";
  intake.AddImage(ImageAt(5), 100);
  intake.Take(100);
  EXPECT_THAT(intake.DescribeWait(100), HasSubstr("camera_info"));
  intake.AddCameraInfo(MakeInfo());
  intake.Take(101);
  EXPECT_EQ(intake.DescribeWait(101), "") << "poses may be late";
  EXPECT_THAT(intake.DescribeWait(104), AllOf(HasSubstr("5.000000000"), HasSubstr("tf has no \"cam\" in \"map\"")));
  tf.x[5 * kSecond] = 0;
  intake.AddImage(ImageAt(6), 104);
  intake.Take(104);
  EXPECT_EQ(intake.DescribeWait(200), "") << "some images never get a pose: that is usual";
}

TEST(IntakeFromTf, AShortBagThatLoopsTellsWhatIsMissing) {
  FakeTf tf;
  KeyframeIntake intake(TfOptions(), {}, 0, tf.source());
  intake.AddCameraInfo(MakeInfo());
  intake.AddImage(ImageAt(5));
  intake.Take(0);
  intake.AddImage(ImageAt(1));
  const Result result = Split(intake.Take(0));
  EXPECT_EQ(result.jumps, 1);
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_EQ(result.drops[0].reason, "no_pose");
  EXPECT_THAT(result.drops[0].message, HasSubstr("tf has no"));
}

TEST(IntakeExtrinsic, ImagesWaitForItAndThenUseIt) {
  KeyframeIntake intake = MakeIntake(BodyOptions());
  EXPECT_THAT(Feed(&intake, 5, 1, CloudAt(5, "map", {{1, 2, 3}})).keyframes, IsEmpty());
  RigidTransform body_from_cam = RigidTransform::Identity();
  body_from_cam.translation().x() = 10;
  intake.SetExtrinsic(body_from_cam);
  std::vector<IntakeEvent> events = intake.TakeAll();
  const auto* notice = std::get_if<Notice>(&events.at(0));
  ASSERT_TRUE(notice);
  EXPECT_FALSE(notice->warning);
  EXPECT_THAT(notice->text, HasSubstr("topic extrinsic"));
  EXPECT_EQ(Split(std::move(events)).keyframes.at(0).world_from_cam.translation().x(), 11);
}

TEST(IntakeExtrinsic, IsLookedUpBetweenTheFramesOfPoseAndImage) {
  FakeTf tf;
  tf.body_from_cam = RigidTransform::Identity();
  tf.body_from_cam->translation().x() = 20;
  KeyframeIntake intake(BodyOptions(), {}, 0, tf.source());
  intake.AddCameraInfo(MakeInfo());
  PoseSample pose = PoseAt(5, 1);
  pose.child_frame = "imu";
  intake.AddPose(pose);
  intake.AddImage(ImageAt(5));
  EXPECT_EQ(Split(intake.TakeAll()).keyframes.at(0).world_from_cam.translation().x(), 21);
}

TEST(IntakeExtrinsic, DroppedImagesSayThatItIsMissing) {
  NodeOptions options = BodyOptions();
  options.matcher.image_capacity = 1;
  KeyframeIntake intake = MakeIntake(options);
  Feed(&intake, 5, 0, nullptr);
  const Result result = Feed(&intake, 6, 0, nullptr);
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_EQ(result.drops[0].reason, "no_extrinsic");
  EXPECT_THAT(result.drops[0].message, AllOf(HasSubstr("5.000000000"), HasSubstr("~T_body_cam")));
}

TEST(IntakeExtrinsic, ThePathMayHoldPosesOfTheBodyWhenTheOthersAreTheCameras) {
  NodeOptions options;
  options.path_child = PoseSemantics::Child::kBody;
  KeyframeIntake intake = MakeIntake(options);
  const auto without = Feed(&intake, 5, 1, nullptr).keyframes.at(0);
  EXPECT_EQ(without.world_from_cam.translation().x(), 1) << "needs no extrinsic";
  EXPECT_FALSE(without.path.child_from_cam) << "that of the path is not known";
  RigidTransform body_from_cam = RigidTransform::Identity();
  body_from_cam.translation().x() = 10;
  intake.SetExtrinsic(body_from_cam);
  const auto with = Feed(&intake, 6, 2, nullptr).keyframes.at(0);
  EXPECT_EQ(with.world_from_cam.translation().x(), 2);
  ASSERT_TRUE(with.path.child_from_cam);
  EXPECT_EQ(with.path.child_from_cam->translation().x(), 10);
  EXPECT_FALSE(with.path.maps_world_to_child);
}

TEST(IntakeFromTf, KeyframesSayWhatPosesOfAPathMeanForThem) {
  NodeOptions options;
  options.pose = {PoseSemantics::Direction::kCamFromWorld, PoseSemantics::Child::kCameraFlu, std::nullopt};
  options.matcher.sync_tolerance_s = 0.003;
  KeyframeIntake intake = MakeIntake(options);
  const auto keyframe = Feed(&intake, 5, 1, nullptr).keyframes.at(0);
  EXPECT_TRUE(keyframe.path.maps_world_to_child);
  EXPECT_EQ(keyframe.path.tolerance_ns, 3000000);
  EXPECT_EQ(keyframe.path_frame, "map");
  // The same pose in a path is the same pose of the camera.
  const RigidTransform received = PoseAt(5, 1).received;
  EXPECT_TRUE((received.inverse() * *keyframe.path.child_from_cam).isApprox(keyframe.world_from_cam, 1e-12));

  options.world_frame = "earth";
  options.matcher.sync_tolerance_s = 0;
  KeyframeIntake renamed = MakeIntake(options);
  const auto other = Feed(&renamed, 5, 1, nullptr).keyframes.at(0);
  EXPECT_EQ(other.path_frame, "") << "the frames of all inputs are replaced";
  EXPECT_EQ(other.path.tolerance_ns, 1000) << "a double is up to 119 ns off";
}

acmp_mapping::KeyframePtr MakeKeyframe(uint32_t stamp_s) {
  auto keyframe = boost::make_shared<acmp_mapping::Keyframe>();
  keyframe->header.stamp = ros::Time(stamp_s, 0);
  keyframe->header.frame_id = "map";
  keyframe->image = *ImageAt(stamp_s)->raw;
  keyframe->image.data.resize(1);
  keyframe->camera_info = MakeInfo();
  keyframe->pose.position.x = 1.5;
  keyframe->pose.orientation.w = 1;
  return keyframe;
}

NodeOptions External() {
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kExternal;
  return options;
}

TEST(IntakeOfKeyframes, TakesAllFromOneMessage) {
  KeyframeIntake intake(External(), {}, 0);
  intake.AddKeyframe(MakeKeyframe(5));
  const Result result = Split(intake.TakeAll());
  ASSERT_EQ(result.keyframes.size(), 1u);
  EXPECT_EQ(result.keyframes[0].stamp_ns, 5 * kSecond);
  EXPECT_EQ(result.keyframes[0].world_frame, "map");
  EXPECT_EQ(result.keyframes[0].camera_frame, "cam");
  EXPECT_EQ(result.keyframes[0].world_from_cam.translation().x(), 1.5);
  EXPECT_EQ(result.keyframes[0].calibration->camera.width, 64);
  EXPECT_TRUE(result.keyframes[0].image->raw);
}

TEST(IntakeOfKeyframes, TakesCompressedImagesToo) {
  KeyframeIntake intake(External(), {}, 0);
  const auto keyframe = MakeKeyframe(5);
  keyframe->image = sensor_msgs::Image();
  keyframe->compressed_image.header.frame_id = "jpeg_cam";
  keyframe->compressed_image.data.resize(1);
  intake.AddKeyframe(keyframe);
  const Result result = Split(intake.TakeAll());
  EXPECT_TRUE(result.keyframes.at(0).image->compressed);
  EXPECT_EQ(result.keyframes.at(0).camera_frame, "jpeg_cam");
}

TEST(IntakeOfKeyframes, TakesAllOrNothing) {
  KeyframeIntake intake(External(), {}, 0);
  const auto bad_pose = MakeKeyframe(5);
  bad_pose->pose.orientation.w = 2;
  EXPECT_THROW(intake.AddKeyframe(bad_pose), InvalidInputError);
  const auto bad_cloud = MakeKeyframe(6);
  bad_cloud->points.width = bad_cloud->points.height = 1;  // and no field
  EXPECT_THROW(intake.AddKeyframe(bad_cloud), InvalidInputError);
  const auto bad_camera = MakeKeyframe(7);
  bad_camera->camera_info.K[0] = 0;
  EXPECT_THROW(intake.AddKeyframe(bad_camera), InvalidInputError);
  intake.AddKeyframe(MakeKeyframe(8));
  const Result result = Split(intake.TakeAll());
  EXPECT_THAT(result.drops, IsEmpty());
  ASSERT_EQ(result.keyframes.size(), 1u);
  EXPECT_EQ(result.keyframes[0].stamp_ns, 8 * kSecond);
}

TEST(IntakeOfKeyframes, NoticesAJumpBackInTime) {
  KeyframeIntake intake(External(), {}, 0);
  intake.AddKeyframe(MakeKeyframe(50));
  intake.AddKeyframe(MakeKeyframe(5));
  const Result result = Split(intake.TakeAll());
  EXPECT_EQ(result.keyframes.size(), 2u);
  EXPECT_EQ(result.jumps, 1);
}

TEST(IntakeWarns, OfAWrongConvention) {
  KeyframeIntake intake = MakeIntake();
  std::vector<std::string> warnings;
  for (uint32_t i = 0; i < 10; ++i) {
    // Behind the camera for whoever reads the pose as the camera's in the world; before it for its inverse.
    PoseSample pose = PoseAt(i, 0);
    pose.received.translation().z() = 5;
    std::vector<Eigen::Vector3d> points;  // new ones each time
    for (int k = 0; k < 24; ++k) points.emplace_back(0.01 * k, 0, -4 + 0.1 * i);
    intake.AddCloud(CloudAt(i, "map", points));
    intake.AddPose(pose);
    intake.AddImage(ImageAt(i));
    for (const IntakeEvent& event : intake.TakeAll()) {
      if (const auto* notice = std::get_if<Notice>(&event)) warnings.push_back(notice->text);
    }
  }
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("~pose_is: T_cam_world")));
  EXPECT_EQ(intake.share_in_front(), 0.0);
}

}  // namespace
}  // namespace acmp::test
