// Source cameras: where they are, which of their images go with a keyframe, and what is said of the others. Inputs are
// named by whole seconds.

#include "acmp_mapping/ros/source_cameras.h"

#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/keyframe_intake.h"

namespace acmp::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kPairBaseline = 0.11;

/// Of a rectified pair; the right one has a baseline.
sensor_msgs::CameraInfo PairInfo(const std::string& frame_id, double baseline = 0, uint32_t width = 64) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = frame_id;
  info.width = width;
  info.height = 48;
  info.K = {50, 0, 32, 0, 50, 24, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {50, 0, 32, -50 * baseline, 0, 50, 24, 0, 0, 0, 1, 0};
  return info;
}

std::shared_ptr<const EncodedImage> PictureAt(double stamp_s, const std::string& frame_id) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = ros::Time(stamp_s);
  image->header.frame_id = frame_id;
  return std::make_shared<const EncodedImage>(EncodedImage{image, nullptr});
}

NodeOptions WithSources(int cameras) {
  NodeOptions options;
  options.matcher.source_cameras = cameras;
  return options;
}

struct PairResult {
  std::vector<KeyframeInput> keyframes;
  std::vector<RejectedInput> drops;
  std::vector<std::string> notices;
};

/// A mapper's intake with source cameras.
class Rig {
 public:
  explicit Rig(const NodeOptions& options, const TransformLookup& lookup = {})
      : intake(options, KeyframeGateOptions(), 0, {{}, lookup}) {
    intake.AddCameraInfo(PairInfo("left"));
    intake.set_clouds_expected(false);
    for (int i = 0; i < options.matcher.source_cameras; ++i) intake.set_source_expected(static_cast<size_t>(i), true);
  }

  /// Feeds an image with its pose.
  void AddImage(double stamp_s) {
    PoseSample pose;
    pose.stamp_ns = ToStampNs(ros::Time(stamp_s));
    intake.AddPose(pose);
    intake.AddImage(PictureAt(stamp_s, "left"));
  }

  PairResult Take(double now_s) { return Split(intake.Take(now_s)); }
  PairResult TakeAll() { return Split(intake.TakeAll()); }

  KeyframeIntake intake;

 private:
  static PairResult Split(const std::vector<IntakeEvent>& events) {
    PairResult result;
    for (const IntakeEvent& event : events) {
      if (const auto* keyframe = std::get_if<KeyframeInput>(&event)) result.keyframes.push_back(*keyframe);
      if (const auto* drop = std::get_if<RejectedInput>(&event)) result.drops.push_back(*drop);
      if (const auto* notice = std::get_if<Notice>(&event)) result.notices.push_back(notice->text);
    }
    return result;
  }
};

/// The one keyframe of a rig whose source camera has this camera_info.
PairResult FeedPair(const NodeOptions& options, const sensor_msgs::CameraInfo& right,
                    const TransformLookup& lookup = {}) {
  Rig rig(options, lookup);
  rig.intake.AddSourceCameraInfo(0, right);
  rig.AddImage(5);
  rig.intake.AddSourceImage(0, PictureAt(5, right.header.frame_id));
  PairResult result = rig.TakeAll();
  EXPECT_THAT(result.keyframes, SizeIs(1)) << "nothing is lost";
  for (const RejectedInput& drop : result.drops) EXPECT_FALSE(drop.ends_image);
  return result;
}

Eigen::Vector3d CentreOf(const PairResult& result) {
  return result.keyframes.at(0).source_images.at(0).source_from_cam.inverse().translation();
}

TEST(SourceCamerasTest, PTellsTheBaselineOfARectifiedPair) {
  NodeOptions options = WithSources(1);
  options.rectified = true;
  const PairResult result = FeedPair(options, PairInfo("left", kPairBaseline, 80));
  EXPECT_LT((CentreOf(result) - Eigen::Vector3d(kPairBaseline, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(result.keyframes[0].source_images[0].calibration->camera.width, 80) << "sizes may differ";
  EXPECT_THAT(result.notices, ElementsAre(AllOf(HasSubstr("source camera 1"), HasSubstr("0.11"), HasSubstr("by P"))));
  EXPECT_THAT(result.drops, IsEmpty());
}

TEST(SourceCamerasTest, PAndRTellWhereThoseOfARawPairAre) {
  sensor_msgs::CameraInfo right = PairInfo("right", kPairBaseline);
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(right.R.data()) = turn;
  const PairResult result = FeedPair(WithSources(1), right);
  EXPECT_LT((CentreOf(result) - Eigen::Vector3d(kPairBaseline, 0, 0)).norm(), 1e-12);
  const RigidTransform& source_from_cam = result.keyframes.at(0).source_images.at(0).source_from_cam;
  EXPECT_LT((source_from_cam.linear() - turn.transpose()).norm(), 1e-12);
}

TEST(SourceCamerasTest, TheParameterCountsMostThenPThenTf) {
  RigidTransform of_tf = RigidTransform::Identity(), of_parameter = RigidTransform::Identity();
  of_tf.translation().x() = -0.3;
  of_parameter.translation().x() = 0.5;
  const auto lookup = [&](const std::string& target, const std::string& source) {
    return target == "right" && source == "left" ? std::make_optional(of_tf) : std::nullopt;
  };
  EXPECT_NEAR(CentreOf(FeedPair(WithSources(1), PairInfo("right"), lookup)).x(), 0.3, 1e-12);
  EXPECT_NEAR(CentreOf(FeedPair(WithSources(1), PairInfo("right", kPairBaseline), lookup)).x(), kPairBaseline, 1e-12);
  NodeOptions options = WithSources(1);
  options.cam_from_sources = {of_parameter};
  EXPECT_NEAR(CentreOf(FeedPair(options, PairInfo("right", kPairBaseline), lookup)).x(), 0.5, 1e-12);
}

TEST(SourceCamerasTest, OneWhosePlaceNobodyTellsIsNamed) {
  const PairResult unknown = FeedPair(WithSources(1), PairInfo("right"));
  EXPECT_THAT(unknown.keyframes[0].source_images, IsEmpty());
  ASSERT_THAT(unknown.drops, SizeIs(1));
  EXPECT_EQ(unknown.drops[0].reason, "source_camera_unplaced");
  EXPECT_THAT(unknown.drops[0].message, AllOf(HasSubstr("source camera 1"), HasSubstr("no baseline"),
                                              HasSubstr("from \"right\" to \"left\""), HasSubstr("~T_cam_source")));
  const auto same_place = [](const std::string&, const std::string&) {
    return std::make_optional(RigidTransform(RigidTransform::Identity()));
  };
  const PairResult zero = FeedPair(WithSources(1), PairInfo("left"), same_place);
  EXPECT_THAT(zero.keyframes[0].source_images, IsEmpty());
  ASSERT_THAT(zero.drops, SizeIs(1));
  EXPECT_THAT(zero.drops[0].message, HasSubstr("it is where the camera is"));
}

TEST(SourceCamerasTest, OneWithoutCameraInfoIsNamed) {
  Rig rig(WithSources(1));
  sensor_msgs::CameraInfo bad = PairInfo("right", kPairBaseline);
  bad.K[0] = 0;
  EXPECT_THROW(rig.intake.AddSourceCameraInfo(0, bad), InvalidInputError);
  rig.AddImage(5);
  rig.intake.AddSourceImage(0, PictureAt(5, "right"));
  const PairResult result = rig.TakeAll();
  ASSERT_THAT(result.keyframes, SizeIs(1));
  ASSERT_THAT(result.drops, SizeIs(1));
  EXPECT_EQ(result.drops[0].reason, "no_source_camera_info");
}

TEST(SourceCamerasTest, AnImageWaitsForItsOwnAndNotForever) {
  Rig rig(WithSources(2));
  for (const size_t camera : {0, 1}) rig.intake.AddSourceCameraInfo(camera, PairInfo("right", kPairBaseline));
  rig.AddImage(5);
  rig.intake.AddSourceImage(0, PictureAt(5.004, "right"));  // ~source_tolerance is 5 ms
  EXPECT_THAT(rig.Take(10).keyframes, IsEmpty());
  rig.intake.AddSourceImage(1, PictureAt(4.99, "right"));
  EXPECT_THAT(rig.Take(10.4).keyframes, IsEmpty());
  const PairResult result = rig.Take(10.5);
  ASSERT_THAT(result.keyframes, SizeIs(1));
  EXPECT_THAT(result.keyframes[0].source_images, SizeIs(1));
  ASSERT_THAT(result.drops, SizeIs(1));
  EXPECT_EQ(result.drops[0].reason, "no_source_image");
  EXPECT_THAT(result.drops[0].message, AllOf(HasSubstr("without source camera 2"), HasSubstr("within 5 ms")));
  EXPECT_FALSE(result.drops[0].ends_image);
}

TEST(SourceCamerasTest, NobodyWaitsForOneThatNobodyPublishes) {
  Rig rig(WithSources(1));
  rig.intake.set_source_expected(0, false);
  rig.AddImage(5);
  EXPECT_THAT(rig.Take(10).keyframes, SizeIs(1));
}

TEST(SourceCamerasTest, AFileForEachIsNeeded) {
  NodeOptions options = WithSources(2);
  options.source_calibration_file = "one.yaml";
  try {
    SourceCameras(options, {});
    FAIL();
  } catch (const InvalidInputError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("1 file(s)"), HasSubstr("~source_cameras = 2")));
  }
}

}  // namespace
}  // namespace acmp::test
