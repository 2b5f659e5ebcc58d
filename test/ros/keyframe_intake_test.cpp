#include "acmp_mapping/ros/keyframe_intake.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "ros/intake_support.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(KeyframeIntake, PutsAKeyframeTogether) {
  KeyframeIntake intake = MakeIntake();
  const Result result = Feed(&intake, 5, 1.5, CloudAt(5, "map", {{1, 2, 3}}), "/cam", "map");
  ASSERT_EQ(result.keyframes.size(), 1u);
  const KeyframeInput& keyframe = result.keyframes[0];
  EXPECT_EQ(keyframe.stamp_ns, 5000000000);
  EXPECT_EQ(keyframe.camera_frame, "cam");
  EXPECT_EQ(keyframe.world_frame, "map");
  EXPECT_EQ(keyframe.world_from_cam.translation().x(), 1.5);
  EXPECT_THAT(keyframe.landmarks_in_world, ElementsAre(Eigen::Vector3d(1, 2, 3)));
  EXPECT_EQ(keyframe.calibration->camera.width, 64);
  EXPECT_THAT(result.drops, IsEmpty());
}

TEST(KeyframeIntake, MovesPointsOfTheCameraFrameIntoTheWorld) {
  KeyframeIntake intake = MakeIntake();
  EXPECT_THAT(Feed(&intake, 5, 1.5, CloudAt(5, "cam", {{1, 2, 3}})).keyframes.at(0).landmarks_in_world,
              ElementsAre(Eigen::Vector3d(2.5, 2, 3)));
  // By the pose at the cloud's stamp, not at the image's.
  const Result later = Feed(&intake, 6, 10, nullptr);
  EXPECT_THAT(later.keyframes.at(0).landmarks_in_world, ElementsAre(Eigen::Vector3d(2.5, 2, 3)));
}

TEST(KeyframeIntake, SparseFrameOverridesTheName) {
  NodeOptions options;
  options.sparse_frame = SparseFrame::kCamera;
  KeyframeIntake camera = MakeIntake(options);
  EXPECT_EQ(Feed(&camera, 5, 1, CloudAt(5, "map", {{1, 2, 3}})).keyframes.at(0).landmarks_in_world.at(0).x(), 2);
  options.sparse_frame = SparseFrame::kWorld;
  KeyframeIntake world = MakeIntake(options);
  EXPECT_EQ(Feed(&world, 5, 1, CloudAt(5, "odd", {{1, 2, 3}})).keyframes.at(0).landmarks_in_world.at(0).x(), 1);
}

TEST(KeyframeIntake, SaysWhyPointsAreNotUsedAndKeepsTheKeyframe) {
  KeyframeIntake intake = MakeIntake();
  Result result = Feed(&intake, 5, 0, CloudAt(5, "odd", {{1, 2, 3}}));
  EXPECT_EQ(result.keyframes.size(), 1u);
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_EQ(result.drops[0].reason, "sparse_frame_unknown");
  EXPECT_THAT(result.drops[0].message,
              AllOf(HasSubstr("\"odd\""), HasSubstr("\"map\""), HasSubstr("\"cam\""), HasSubstr("~sparse_frame")));

  Feed(&intake, 6, 0, CloudAt(6, "map", {{1, 2, 3}}));
  auto empty = std::make_shared<SparseCloud>();
  empty->stamp_ns = ToStampNs(ros::Time(7, 0));
  empty->not_finite = 7;
  empty->zero = 9;
  result = Feed(&intake, 7, 0, empty);
  EXPECT_EQ(result.keyframes.size(), 1u) << "the frontend had points before";
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_THAT(result.drops[0].message, AllOf(HasSubstr("7 not finite"), HasSubstr("9 exactly zero")));

  KeyframeIntake unposed = MakeIntake();
  result = Feed(&unposed, 5, 0, CloudAt(3, "cam", {{1, 2, 3}}));
  EXPECT_EQ(result.keyframes.size(), 1u);
  EXPECT_EQ(result.drops.at(0).reason, "sparse_without_pose");
}

TEST(KeyframeIntake, NamesFramesThatHaveNone) {
  NodeOptions options;
  KeyframeIntake nameless(options, KeyframeGateOptions(), 0);
  nameless.AddCameraInfo(MakeInfo(""));
  const Result result = Feed(&nameless, 5, 0, CloudAt(5, "", {{1, 2, 3}}), "", "");
  EXPECT_EQ(result.keyframes.at(0).camera_frame, "camera_optical");
  EXPECT_EQ(result.keyframes.at(0).world_frame, "world");
  EXPECT_EQ(result.keyframes.at(0).landmarks_in_world.size(), 1u);

  KeyframeIntake info = MakeIntake();
  EXPECT_EQ(Feed(&info, 5, 0, nullptr, "", "map").keyframes.at(0).camera_frame, "cam");
  options.world_frame = "earth";
  KeyframeIntake overridden = MakeIntake(options);
  EXPECT_EQ(Feed(&overridden, 5, 0, nullptr).keyframes.at(0).world_frame, "earth");
}

/// A lens that is focused: poses come later than the next image's camera_info.
TEST(KeyframeIntake, AnImageGetsTheCameraOfItsStamp) {
  KeyframeIntake intake(NodeOptions(), KeyframeGateOptions(), 0);
  for (uint32_t stamp_s = 5; stamp_s < 8; ++stamp_s) {
    sensor_msgs::CameraInfo info = MakeInfo();
    info.header.stamp = ros::Time(stamp_s, 0);
    info.K[0] = 10 * stamp_s;
    intake.AddCameraInfo(info);
    intake.AddImage(ImageAt(stamp_s));
  }
  for (uint32_t stamp_s = 5; stamp_s < 8; ++stamp_s) intake.AddPose(PoseAt(stamp_s, stamp_s));
  const Result result = Split(intake.TakeAll());
  ASSERT_EQ(result.keyframes.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(result.keyframes[i].calibration->camera.fx, 10 * (5 + static_cast<double>(i)));
  }
}

TEST(KeyframeIntake, WaitsForAUsableCamera) {
  KeyframeIntake intake(NodeOptions(), KeyframeGateOptions(), 0);
  sensor_msgs::CameraInfo bad = MakeInfo();
  bad.K[0] = 0;
  EXPECT_THROW(intake.AddCameraInfo(bad), InvalidInputError);
  EXPECT_THAT(Feed(&intake, 5, 0, nullptr).keyframes, IsEmpty());
  intake.AddCameraInfo(MakeInfo());
  EXPECT_EQ(Split(intake.TakeAll()).keyframes.size(), 1u);
  EXPECT_THROW(intake.AddCameraInfo(bad), InvalidInputError);
  EXPECT_THAT(Feed(&intake, 6, 0, nullptr).keyframes, IsEmpty()) << "the old camera holds no longer";
}

TEST(KeyframeIntake, RefusesImagesWhoseCameraWasReplacedByAnUnusableOne) {
  sensor_msgs::CameraInfo bad = MakeInfo();
  bad.K[0] = -1;
  for (const bool image_first : {false, true}) {  // the jump lets the waiting image go, with its cloud
    KeyframeIntake intake = MakeIntake();
    intake.set_clouds_expected(true);
    intake.AddCloud(CloudAt(100, "map", {{0, 0, 2}}));
    intake.AddPose(PoseAt(100, 0));
    intake.AddImage(ImageAt(100));
    if (image_first) intake.AddImage(ImageAt(1));
    EXPECT_THROW(intake.AddCameraInfo(bad), InvalidInputError);
    if (!image_first) intake.AddImage(ImageAt(1));
    const Result result = Split(intake.Take(0));
    EXPECT_TRUE(result.keyframes.empty());
    ASSERT_EQ(result.drops.size(), 1u);
    EXPECT_EQ(result.drops[0].reason, "no_camera_info");
  }
}

TEST(KeyframeIntake, RefusesACameraWhoseImagesWouldTakeTooMuchMemory) {
  KeyframeIntake intake = MakeIntake();
  sensor_msgs::CameraInfo info = MakeInfo();
  info.width = info.height = 16384;
  EXPECT_THAT(ErrorOf([&] { intake.AddCameraInfo(info); }),
              HasSubstr("an image of 16384x16384 pixels, as camera_info has it, would take 6.44245 GB of memory: "
                        "must be at most 1 (memory_limit)"));
}

TEST(KeyframeIntake, SharesTheCalibrationUntilItChanges) {
  KeyframeIntake intake = MakeIntake();
  const CalibrationPtr first = Feed(&intake, 5, 0, nullptr).keyframes.at(0).calibration;
  sensor_msgs::CameraInfo info = MakeInfo();
  info.header.stamp = ros::Time(6, 0);
  intake.AddCameraInfo(info);
  EXPECT_EQ(Feed(&intake, 6, 0, nullptr).keyframes.at(0).calibration, first);
  info.K[0] = 60;
  intake.AddCameraInfo(info);
  EXPECT_EQ(Feed(&intake, 7, 0, nullptr).keyframes.at(0).calibration->camera.fx, 60);
}

TEST(KeyframeIntake, GateMeasuresBaselinesByTheLandmarks) {
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kGate;
  for (const double scale : {0.01, 100.0}) {
    KeyframeIntake intake = MakeIntake(options);
    const std::vector<Eigen::Vector3d> points = {{0, 0, 4 * scale}, {0, 0, 4 * scale}, {0, 0, -900 * scale}};
    EXPECT_EQ(Feed(&intake, 1, 0, CloudAt(1, "map", points)).keyframes.size(), 1u);
    EXPECT_EQ(Feed(&intake, 2, 0.079 * scale, CloudAt(2, "map", points)).keyframes.size(), 0u);
    EXPECT_EQ(Feed(&intake, 3, 0.081 * scale, CloudAt(3, "map", points)).keyframes.size(), 1u);
    EXPECT_EQ(intake.not_chosen(), 1u);
  }
}

TEST(KeyframeIntake, GateUsesTheFallbackDepthWithoutLandmarks) {
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kGate;
  KeyframeIntake intake = MakeIntake(options, 4);
  EXPECT_EQ(Feed(&intake, 1, 0, nullptr).keyframes.size(), 1u);
  EXPECT_EQ(Feed(&intake, 2, 0.079, nullptr).keyframes.size(), 0u);
  EXPECT_EQ(Feed(&intake, 3, 0.081, nullptr).keyframes.size(), 1u);
}

/// Landmarks enough to compare, at this depth.
std::vector<Eigen::Vector3d> WallAt(double depth) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 100; ++i) points.emplace_back(0.02 * depth * (i % 10 - 5), 0.02 * depth * (i / 10 - 5), depth);
  return points;
}

TEST(KeyframeIntake, NothingOfAStartThatFailsIsUsed) {
  KeyframeIntake intake = MakeIntake();
  const auto add = [&](uint32_t stamp_s, const std::vector<Eigen::Vector3d>& points) {
    intake.AddCloud(CloudAt(stamp_s, "map", points));
    intake.AddPose(PoseAt(stamp_s, 0));
    intake.AddImage(ImageAt(stamp_s));
    return Split(intake.Take(0));
  };
  EXPECT_EQ(add(0, {}).drops.size(), 1u) << "sparse_empty";
  Result result = add(1, {});
  EXPECT_THAT(result.keyframes, IsEmpty());
  for (size_t i : {1, 2}) {
    EXPECT_EQ(result.drops.at(i).reason, "not_initialised");
    EXPECT_TRUE(result.drops.at(i).ends_image);
  }

  EXPECT_THAT(add(2, WallAt(4)).keyframes, IsEmpty()) << "its scale may still change";
  EXPECT_EQ(intake.waiting_images(), 1u);
  EXPECT_THAT(intake.DescribeWait(0), HasSubstr("settled"));
  result = add(3, WallAt(2));
  ASSERT_EQ(result.drops.size(), 1u);
  EXPECT_EQ(result.drops[0].reason, "not_settled");
  EXPECT_THAT(result.drops[0].message, HasSubstr("2.000000000"));
  EXPECT_EQ(Split(intake.TakeAll()).keyframes.size(), 1u) << "a flush waits for nothing";
}

TEST(KeyframeIntake, ResetAccountsForWhatWaitedForTheFrontend) {
  KeyframeIntake intake = MakeIntake();
  intake.AddCloud(CloudAt(2, "map", {}));
  intake.AddPose(PoseAt(2, 0));
  intake.AddImage(ImageAt(2));
  intake.Take(0);
  EXPECT_EQ(intake.waiting_images(), 1u);
  intake.Clear();
  const Result result = Split(intake.Take(0));
  EXPECT_EQ(result.drops.at(0).reason, "reset");
  EXPECT_EQ(intake.waiting_images(), 0u);
}

TEST(KeyframeIntake, PassesANewWorldOn) {
  KeyframeIntake intake = MakeIntake();
  EXPECT_EQ(Feed(&intake, 1, 0, CloudAt(1, "map", WallAt(4))).keyframes.size(), 1u);
  const Result result = Feed(&intake, 2, 0, CloudAt(2, "map", WallAt(2)));
  ASSERT_EQ(result.new_worlds.size(), 1u);
  EXPECT_THAT(result.new_worlds[0], AllOf(HasSubstr("2.000000000"), HasSubstr("new part of the map")));
  EXPECT_EQ(result.keyframes.size(), 1u) << "after it";
}

TEST(KeyframeIntake, PassesTimeJumpsOn) {
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kGate;
  KeyframeIntake intake = MakeIntake(options, 4);
  EXPECT_EQ(Feed(&intake, 10, 0, nullptr).keyframes.size(), 1u);
  const Result result = Feed(&intake, 1, 0, nullptr);
  EXPECT_EQ(result.jumps, 1);
  EXPECT_EQ(result.keyframes.size(), 1u) << "the gate starts anew";
}

}  // namespace
}  // namespace acmp::test
