// What the intake makes of images, poses and clouds; of transforms that are looked up, an extrinsic that comes late,
// keyframes in one message, and the images of source cameras. Inputs are named by whole seconds.

#include "acmp_mapping/ros/keyframe_intake.h"

#include <map>
#include <memory>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

/// Of a rectified pair; the right one has a baseline.
sensor_msgs::CameraInfo MakeInfo(const std::string& frame_id = "cam", double baseline = 0, uint32_t width = 64) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = frame_id;
  info.width = width;
  info.height = 48;
  info.K = {50, 0, 32, 0, 50, 24, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {50, 0, 32, -50 * baseline, 0, 50, 24, 0, 0, 0, 1, 0};
  return info;
}

std::shared_ptr<const EncodedImage> ImageAt(double stamp_s, const std::string& frame_id = "cam") {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = ros::Time(stamp_s);
  image->header.frame_id = frame_id;
  return std::make_shared<const EncodedImage>(EncodedImage{image, nullptr});
}

PoseSample PoseAt(uint32_t stamp_s, double x, const std::string& world_frame = "map") {
  PoseSample pose;
  pose.stamp_ns = ToStampNs(ros::Time(stamp_s, 0));
  pose.world_frame = world_frame;
  pose.received.translation().x() = x;
  return pose;
}

SparseCloudPtr CloudAt(uint32_t stamp_s, const std::string& frame_id, std::vector<Eigen::Vector3d> points) {
  auto cloud = std::make_shared<SparseCloud>();
  cloud->stamp_ns = ToStampNs(ros::Time(stamp_s, 0));
  cloud->frame_id = frame_id;
  cloud->points = std::move(points);
  return cloud;
}

struct Result {
  std::vector<KeyframeInput> keyframes;
  std::vector<RejectedInput> drops;
  std::vector<std::string> notices, warnings;  ///< the latter are among the former
};

Result Split(std::vector<IntakeEvent> events) {
  Result result;
  for (IntakeEvent& event : events) {
    if (auto* keyframe = std::get_if<KeyframeInput>(&event)) result.keyframes.push_back(std::move(*keyframe));
    if (auto* drop = std::get_if<RejectedInput>(&event)) result.drops.push_back(*drop);
    auto* notice = std::get_if<Notice>(&event);
    if (notice) result.notices.push_back(notice->text);
    if (notice && notice->warning) result.warnings.push_back(notice->text);
  }
  return result;
}

/// Feeds one image with pose and cloud and returns what comes out.
Result Feed(KeyframeIntake* intake, uint32_t stamp_s, double x, const SparseCloudPtr& cloud,
            const std::string& image_frame = "cam", const std::string& world_frame = "map") {
  if (cloud) intake->AddCloud(cloud);
  intake->AddPose(PoseAt(stamp_s, x, world_frame));
  intake->AddImage(ImageAt(stamp_s, image_frame));
  return Split(intake->TakeAll());
}

KeyframeIntake MakeIntake(const NodeOptions& options = {}, double fallback_depth = 0) {
  KeyframeIntake intake(options, fallback_depth);
  intake.AddCameraInfo(MakeInfo());
  return intake;
}

TEST(KeyframeIntake, MovesPointsOfTheCameraFrameIntoTheWorld) {
  KeyframeIntake intake = MakeIntake();
  EXPECT_THAT(Feed(&intake, 5, 1.5, CloudAt(5, "cam", {{1, 2, 3}})).keyframes.at(0).landmarks_in_world,
              ElementsAre(Eigen::Vector3d(2.5, 2, 3)));
  // By the pose at the cloud's stamp, not at the image's.
  const Result later = Feed(&intake, 6, 10, nullptr);
  EXPECT_THAT(later.keyframes.at(0).landmarks_in_world, ElementsAre(Eigen::Vector3d(2.5, 2, 3)));
}

TEST(KeyframeIntake, KeepsAKeyframeWhosePointsAreNotUsed) {
  KeyframeIntake intake = MakeIntake();
  EXPECT_EQ(Feed(&intake, 5, 0, CloudAt(5, "odd", {{1, 2, 3}})).keyframes.size(), 1u);
  Feed(&intake, 6, 0, CloudAt(6, "map", {{1, 2, 3}}));
  EXPECT_EQ(Feed(&intake, 7, 0, CloudAt(7, "map", {})).keyframes.size(), 1u) << "the frontend had points before";
  KeyframeIntake unposed = MakeIntake();
  const Result result = Feed(&unposed, 5, 0, CloudAt(3, "cam", {{1, 2, 3}}));
  EXPECT_EQ(result.keyframes.size(), 1u);
  EXPECT_EQ(result.drops.at(0).reason, "sparse_without_pose");
}

TEST(KeyframeIntake, NamesFramesThatHaveNone) {
  NodeOptions options;
  KeyframeIntake nameless(options, 0);
  nameless.AddCameraInfo(MakeInfo(""));
  const Result result = Feed(&nameless, 5, 0, CloudAt(5, "", {{1, 2, 3}}), "", "");
  EXPECT_EQ(result.keyframes.at(0).camera_frame, "camera_optical");
  EXPECT_EQ(result.keyframes.at(0).world_frame, "world");
  EXPECT_EQ(result.keyframes.at(0).landmarks_in_world.size(), 1u);

  KeyframeIntake info = MakeIntake();
  EXPECT_EQ(Feed(&info, 5, 0, nullptr, "", "map").keyframes.at(0).camera_frame, "cam");
  options.world_frame = "earth";
  KeyframeIntake overridden = MakeIntake(options);
  const Result first = Feed(&overridden, 5, 0, nullptr);
  EXPECT_EQ(first.keyframes.at(0).world_frame, "earth");
  EXPECT_THAT(first.notices, ElementsAre(HasAll("\"map\"", "\"earth\""))) << "told";
  EXPECT_THAT(Feed(&overridden, 6, 0, nullptr).notices, IsEmpty()) << "once";
  KeyframeIntake same = MakeIntake(options);
  EXPECT_THAT(Feed(&same, 5, 0, nullptr, "cam", "earth").notices, IsEmpty());
}

/// A lens that is focused: poses come later than the next image's camera_info.
TEST(KeyframeIntake, AnImageGetsTheCameraOfItsStamp) {
  KeyframeIntake intake(NodeOptions(), 0);
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
  EXPECT_REFUSED(intake.AddCameraInfo(info),
                 "an image of 16384x16384 pixels, as camera_info has it, would take 6.44245 GB of memory: "
                 "must be at most 1 (memory_limit)");
}

TEST(KeyframeIntake, SceneDepthIsThatOfTheLandmarksOrTheFallback) {
  const std::vector<Eigen::Vector3d> points = {{0, 0, 4}, {0, 0, 4}, {0, 0, -900}};
  KeyframeIntake intake = MakeIntake({}, 7);
  EXPECT_EQ(Feed(&intake, 1, 0, nullptr).keyframes.at(0).scene_depth, 7);
  EXPECT_EQ(Feed(&intake, 2, 0, CloudAt(2, "map", points)).keyframes.at(0).scene_depth, 4);
  EXPECT_EQ(Feed(&intake, 3, 0, nullptr).keyframes.at(0).scene_depth, 4);
  KeyframeIntake unknown = MakeIntake();
  EXPECT_EQ(Feed(&unknown, 1, 0, nullptr).keyframes.at(0).scene_depth, 0);
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
  options.pose_source = kTfPoses;
  options.world_frame = "map";
  return options;
}

NodeOptions BodyOptions() {
  NodeOptions options;
  options.pose.child = PoseSemantics::Child::kBody;
  return options;
}

TEST(KeyframeIntake, DroppedImagesSayWhatTheyLacked) {
  struct Case {
    NodeOptions options;
    std::string image_frame, reason, word;
  };
  for (Case missing :
       {Case{TfOptions(), "optical", "no_pose", "tf has no \"optical\" in \"map\""},
        Case{TfOptions(), "", "no_pose", "~camera_frame"}, Case{BodyOptions(), "cam", "no_extrinsic", "~T_body_cam"}}) {
    FakeTf tf;
    missing.options.matcher.image_capacity = 1;
    KeyframeIntake intake(missing.options, 0, tf.source());
    intake.AddCameraInfo(MakeInfo(""));
    for (const uint32_t stamp_s : {5, 6}) {
      if (missing.reason == "no_extrinsic") intake.AddPose(PoseAt(stamp_s, 0));
      intake.AddImage(ImageAt(stamp_s, missing.image_frame));
      const Result result = Split(intake.Take(0));
      if (stamp_s == 5) continue;
      ASSERT_EQ(result.drops.size(), 1u);
      EXPECT_EQ(result.drops[0].reason, missing.reason);
      EXPECT_THAT(result.drops[0].message, HasAll("5.000000000", missing.word));
    }
  }
}

TEST(IntakeFromTf, SaysWhatImagesWaitForBeforeAnyIsDropped) {
  FakeTf tf;
  KeyframeIntake intake(TfOptions(), 0, tf.source());
  intake.set_clouds_expected(false);
  EXPECT_EQ(intake.DescribeWait(100), "") << "no image, no wait";
  intake.AddImage(ImageAt(5), 100);
  intake.Take(100);
  EXPECT_THAT(intake.DescribeWait(100), HasSubstr("camera_info"));
  intake.AddCameraInfo(MakeInfo());
  intake.Take(101);
  EXPECT_EQ(intake.DescribeWait(101), "") << "poses may be late";
  EXPECT_THAT(intake.DescribeWait(104), HasAll("5.000000000", "tf has no \"cam\" in \"map\""));
  tf.x[5 * kSecond] = 0;
  intake.AddImage(ImageAt(6), 104);
  intake.Take(104);
  EXPECT_EQ(intake.DescribeWait(200), "") << "some images never get a pose: that is usual";
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

TEST(IntakeOfKeyframes, TakesCompressedImagesToo) {
  KeyframeIntake intake(External(), 0);
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
  KeyframeIntake intake(External(), 0);
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

constexpr double kPairBaseline = 0.11;

NodeOptions WithSources(int cameras) {
  NodeOptions options;
  options.matcher.source_cameras = cameras;
  return options;
}

/// The one keyframe of a mapper whose source camera has this camera_info.
Result FeedPair(const NodeOptions& options, const sensor_msgs::CameraInfo& right, const TransformLookup& lookup = {}) {
  KeyframeIntake intake(options, 0, {{}, lookup});
  intake.AddCameraInfo(MakeInfo("left"));
  EXPECT_EQ(ErrorOf([&] { intake.AddSourceCameraInfo(0, right); }) == "no error", right.K[0] > 0);
  const auto image = ImageAt(5, right.header.frame_id);
  intake.AddCompanion(kSourceStream, {ToStampNs(image->header().stamp), image});
  Result result = Feed(&intake, 5, 0, nullptr, "left");
  EXPECT_THAT(result.keyframes, SizeIs(1)) << "nothing is lost";
  for (const RejectedInput& drop : result.drops) EXPECT_FALSE(drop.ends_image);
  return result;
}

Eigen::Vector3d CentreOf(const Result& result) {
  return result.keyframes.at(0).source_images.at(0).source_from_cam.inverse().translation();
}

TEST(SourceCamerasTest, PTellsTheBaselineOfARectifiedPair) {
  NodeOptions options = WithSources(1);
  options.rectified = true;
  const Result result = FeedPair(options, MakeInfo("left", kPairBaseline, 80));
  EXPECT_LT((CentreOf(result) - Eigen::Vector3d(kPairBaseline, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(result.keyframes[0].source_images[0].calibration->camera.width, 80) << "sizes may differ";
  EXPECT_THAT(result.notices, ElementsAre(HasAll("source camera 1", "0.11", "by P")));
  EXPECT_THAT(result.drops, IsEmpty());
}

TEST(SourceCamerasTest, PAndRTellWhereThoseOfARawPairAre) {
  sensor_msgs::CameraInfo right = MakeInfo("right", kPairBaseline);
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(right.R.data()) = turn;
  const Result result = FeedPair(WithSources(1), right);
  EXPECT_LT((CentreOf(result) - Eigen::Vector3d(kPairBaseline, 0, 0)).norm(), 1e-12);
  const RigidTransform& source_from_cam = result.keyframes.at(0).source_images.at(0).source_from_cam;
  EXPECT_LT((source_from_cam.linear() - turn.transpose()).norm(), 1e-12);
}

TEST(SourceCamerasTest, TheParameterCountsMostThenPThenTf) {
  RigidTransform of_tf = RigidTransform::Identity(), of_parameter = RigidTransform::Identity();
  of_tf.translation().x() = -1.05 * kPairBaseline;
  of_parameter.translation().x() = 0.5;
  const auto lookup = [&](const std::string& target, const std::string& source) {
    return target == "right" && source == "left" ? std::make_optional(of_tf) : std::nullopt;
  };
  EXPECT_NEAR(CentreOf(FeedPair(WithSources(1), MakeInfo("right"), lookup)).x(), 1.05 * kPairBaseline, 1e-12);
  EXPECT_NEAR(CentreOf(FeedPair(WithSources(1), MakeInfo("right", kPairBaseline), lookup)).x(), kPairBaseline, 1e-12);
  NodeOptions options = WithSources(1);
  options.cam_from_sources = {of_parameter};
  EXPECT_NEAR(CentreOf(FeedPair(options, MakeInfo("right", kPairBaseline), lookup)).x(), 0.5, 1e-12);
}

TEST(SourceCamerasTest, PThatIsOfAnotherPairIsNotTakenSilently) {
  RigidTransform of_tf = RigidTransform::Identity();
  const auto lookup = [&](const std::string&, const std::string&) { return std::make_optional(of_tf); };
  of_tf.translation().x() = -0.3;
  const Result other_pair = FeedPair(WithSources(1), MakeInfo("right", kPairBaseline), lookup);
  EXPECT_NEAR(CentreOf(other_pair).x(), 0.3, 1e-12);
  EXPECT_THAT(other_pair.warnings, ElementsAre(HasAll("0.11", "T_cam_source")));
  of_tf.translation() = Eigen::Vector3d(0, kPairBaseline, 0);  // of frames with x ahead
  const Result other_axes = FeedPair(WithSources(1), MakeInfo("right", kPairBaseline), lookup);
  EXPECT_NEAR(CentreOf(other_axes).x(), kPairBaseline, 1e-12);
  EXPECT_THAT(other_axes.warnings, SizeIs(1));
}

/// A mapper with a source camera that gets images at 1, 2, ... s.
class SourceCameraStream {
 public:
  explicit SourceCameraStream(const TransformSource& transforms = {}) : intake_(WithSources(1), 0, transforms) {
    intake_.AddCameraInfo(MakeInfo("left"));
  }
  void AddInfo(double stamp_s, double fx) {
    sensor_msgs::CameraInfo info = MakeInfo("right", kPairBaseline);
    info.header.stamp.fromSec(stamp_s);
    info.K[0] = info.K[4] = fx;
    intake_.AddSourceCameraInfo(0, info);
  }
  Result Add(int stamp_s) {
    const auto image = ImageAt(stamp_s, "right");
    intake_.AddCompanion(kSourceStream, {ToStampNs(image->header().stamp), image});
    return Feed(&intake_, stamp_s, 0, nullptr, "left");
  }
  KeyframeIntake& intake() { return intake_; }

 private:
  KeyframeIntake intake_;
};

TEST(SourceCamerasTest, TheirPlaceIsThatOfTheImagesStamp) {
  std::map<int64_t, double> x_at = {{1, 0}, {2, 0.2}, {3, 0.2}, {4, 0.5}, {5, 0.6}};  // a driver that starts with zero
  TransformSource transforms;
  transforms.find_pose = [&](const std::string& target, const std::string& source,
                             int64_t stamp_ns) -> std::variant<PoseSample, std::string> {
    if (target != "right" || source != "left") return "unknown";
    PoseSample pose;
    pose.received.translation().x() = -x_at.at(stamp_ns / kSecond);
    return pose;
  };
  SourceCameraStream stream(transforms);
  sensor_msgs::CameraInfo info = MakeInfo("right");
  stream.intake().AddSourceCameraInfo(0, info);
  const Result first = stream.Add(1);
  ASSERT_THAT(first.drops, SizeIs(1));
  EXPECT_EQ(first.drops[0].reason, "source_camera_unplaced");
  size_t notices = 0;
  for (int stamp_s = 2; stamp_s <= 5; ++stamp_s) {
    const Result result = stream.Add(stamp_s);
    EXPECT_NEAR(CentreOf(result).x(), x_at[stamp_s], 1e-12);
    notices += result.notices.size();
  }
  EXPECT_EQ(notices, 2u) << "where it is, and that it moves";
}

TEST(SourceCamerasTest, TheirCameraInfoIsThatOfTheImagesStamp) {
  SourceCameraStream stream;
  stream.AddInfo(0.5, 100);
  stream.AddInfo(2.5, 200);  // zooms before the images of 1 and 2 s have their pose
  for (const auto& [stamp_s, fx] : {std::pair<int, double>{1, 100}, {2, 100}, {3, 200}}) {
    EXPECT_EQ(stream.Add(stamp_s).keyframes.at(0).source_images.at(0).calibration->camera.fx, fx) << stamp_s;
  }
}

TEST(SourceCamerasTest, OneThatCannotBeUsedIsNamed) {
  const auto same_place = [](const std::string&, const std::string&) {
    return std::make_optional(RigidTransform(RigidTransform::Identity()));
  };
  sensor_msgs::CameraInfo bad = MakeInfo("right", kPairBaseline);
  bad.K[0] = 0;
  const struct {
    Result result;
    std::string reason;
    std::vector<std::string> words;
  } cases[] = {
      {FeedPair(WithSources(1), MakeInfo("right")),
       "source_camera_unplaced",
       {"source camera 1", "no baseline", "from \"right\" to \"left\"", "~T_cam_source"}},
      {FeedPair(WithSources(1), MakeInfo("left"), same_place), "source_camera_unplaced", {"it is where the camera is"}},
      {FeedPair(WithSources(1), bad), "no_source_camera_info", {"source camera 1"}}};
  for (const auto& [result, reason, words] : cases) {
    EXPECT_THAT(result.keyframes.at(0).source_images, IsEmpty());
    ASSERT_THAT(result.drops, SizeIs(1)) << reason;
    EXPECT_EQ(result.drops[0].reason, reason);
    for (const std::string& word : words) EXPECT_THAT(result.drops[0].message, HasSubstr(word));
  }
}

TEST(SourceCamerasTest, AFileForEachIsNeeded) {
  NodeOptions options = WithSources(2);
  options.source_calibration_file = "one.yaml";
  EXPECT_REFUSED(SourceCameras(options, {}), "1 file(s)", "~source_cameras = 2");
}

}  // namespace
}  // namespace acmp::test
