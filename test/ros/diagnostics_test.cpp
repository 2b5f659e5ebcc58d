#include "acmp_mapping/ros/map_diagnostics.h"
#include "acmp_mapping/ros/mapper_diagnostics.h"

#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using Kind = InputStatus::Kind;
using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

template <class Snapshot>
diagnostic_updater::DiagnosticStatusWrapper Describe(void (*describer)(const Snapshot&,
                                                                       diagnostic_updater::DiagnosticStatusWrapper*),
                                                     const Snapshot& snapshot) {
  diagnostic_updater::DiagnosticStatusWrapper status;
  describer(snapshot, &status);
  return status;
}

std::string ValueOf(const diagnostic_updater::DiagnosticStatusWrapper& status, const std::string& key) {
  for (const auto& value : status.values) {
    if (value.key == key) return value.value;
  }
  return "(no such key)";
}

/// A mapper at work: everything arrives.
MapperSnapshot HealthyMapper() {
  MapperSnapshot snapshot;
  snapshot.now_s = 100;
  snapshot.inputs = {{Kind::kImage, "/cam/image", 1, 500, 99.9},
                     {Kind::kCameraInfo, "/cam/camera_info", 1, 500, 99.9},
                     {Kind::kPose, "/slam/pose", 1, 500, 99.9},
                     {Kind::kCloud, "/slam/points", 1, 50, 99.5, false}};
  snapshot.matched = 400;
  snapshot.sync_tolerance_s = 1e-3;
  snapshot.worker.ready = true;
  snapshot.worker.device_name = "cpu (2 threads)";
  snapshot.points_in_front = 0.9;
  return snapshot;
}

TEST(Diagnostics, AnOffsetOfTheStampsIsNamed) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.worker.pose_checks.stamp_offset_s = 0.0312;
  snapshot.worker.pose_checks.contradiction = 0.004;
  const DiagnosticStatusWrapper status = Describe(&DescribeMapping, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("images were taken 31 ms before the poses of the same stamps"));
  EXPECT_EQ(ValueOf(status, "poses contradict the images by [% of the depth]"), "0.4");
  snapshot.worker.pose_checks.stamp_offset_s = -0.02;
  EXPECT_THAT(Describe(&DescribeMapping, snapshot).message, HasSubstr("taken 20 ms after"));
}

TEST(Diagnostics, DistortionThatNobodyToldIsNamed) {
  LensDistortion none, some;
  some.model = LensDistortion::Model::kBrownConrady;
  EXPECT_EQ(DescribeDistortion(5, 640, none), "");
  EXPECT_THAT(DescribeDistortion(-15.24, 640, none), AllOf(HasSubstr("15.2 px of 640 too far in"), HasSubstr("D of")));
  EXPECT_THAT(DescribeDistortion(15, 640, some), AllOf(HasSubstr("too far out"), HasSubstr("~rectified")));
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.worker.distortion = DescribeDistortion(-15, 640, none);
  EXPECT_THAT(Describe(&DescribeMapping, snapshot).message, HasSubstr("radial distortion"));
}

TEST(Diagnostics, NameTheMissingInputItsTopicAndSinceWhen) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.inputs[1] = {Kind::kCameraInfo, "/cam/camera_info", 0, 0, 60};
  auto status = Describe(&DescribeInputs, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, AllOf(HasSubstr("/cam/camera_info"), HasSubstr("40 s"), HasSubstr("nobody publishes"),
                                    Not(HasSubstr("/cam/image"))));
  snapshot = HealthyMapper();
  snapshot.inputs[2].last_received_s = 88;  // was there, fell silent
  status = Describe(&DescribeInputs, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, AllOf(HasSubstr("nothing on /slam/pose for 12 s"), HasSubstr("1 publisher")));
  snapshot = HealthyMapper();
  snapshot.inputs[3] = {Kind::kCloud, "/slam/points", 0, 0, 60, false};
  status = Describe(&DescribeInputs, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK) << "not needed when the depth range is given";
  EXPECT_THAT(ValueOf(status, "/slam/points"), HasSubstr("nobody publishes"));
  snapshot.paused = true;
  EXPECT_THAT(Describe(&DescribeInputs, snapshot).message, HasSubstr("paused"));
}

TEST(Diagnostics, DoNotBlameTheRemapWhenARecordingHasEnded) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.now_s = 200;
  for (InputStatus& input : snapshot.inputs) input.publishers = 0;
  const auto status = Describe(&DescribeInputs, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, AllOf(HasSubstr("after 500 messages nobody publishes it any more: a recording has ended"),
                                    Not(HasSubstr("remap"))));
  EXPECT_EQ(DescribeMissing(snapshot), "") << "no use of repeating that in the log";
}

TEST(Diagnostics, NameMissingInputsInTheLog) {
  EXPECT_EQ(DescribeMissing(HealthyMapper()), "");
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.inputs[0] = {Kind::kImage, "/cam/image", 0, 0, 97};
  EXPECT_EQ(DescribeMissing(snapshot), "") << "3 s are no long wait";
  snapshot.inputs[0].last_received_s = 88;
  EXPECT_THAT(DescribeMissing(snapshot), AllOf(HasSubstr("nothing yet on /cam/image for 12 s"), HasSubstr("remap")));
  snapshot.inputs[2].last_received_s = 90;  // the frontend has stopped, the camera goes on
  EXPECT_THAT(DescribeMissing(snapshot), AllOf(HasSubstr("/cam/image"), HasSubstr("; nothing on /slam/pose for 10 s")));
  snapshot.paused = true;
  EXPECT_EQ(DescribeMissing(snapshot), "");
  snapshot = HealthyMapper();
  snapshot.inputs.push_back({Kind::kSourceImage, "/right/image", 0, 0, 88, false});
  EXPECT_THAT(DescribeMissing(snapshot), HasSubstr("nothing yet on /right/image for 12 s"))
      << "nothing depends on it, but somebody has asked for it";
  snapshot = HealthyMapper();
  snapshot.waiting_images = 7;
  snapshot.waiting_for = "T_body_cam is not known";
  EXPECT_EQ(DescribeMissing(snapshot), "7 images wait: T_body_cam is not known");
}

TEST(Diagnostics, ATopicOfAnotherTypeIsNamedWithWhatToSet) {
  const std::map<std::string, std::string> published = {{"/vio/odometry", "nav_msgs/Odometry"},
                                                        {"/cam/image/compressed", "sensor_msgs/CompressedImage"},
                                                        {"/slam/old_points", "sensor_msgs/PointCloud"}};
  const auto word = [&](Kind kind, const std::string& topic, const std::string& type, bool required = true) {
    MapperSnapshot snapshot = HealthyMapper();
    snapshot.inputs = {{kind, topic, 0, 0, 60, required, type}};
    AddAdvice(published, &snapshot.inputs);
    EXPECT_EQ(DescribeMissing(snapshot), Describe(&DescribeInputs, snapshot).message);
    return DescribeMissing(snapshot);
  };
  EXPECT_EQ(word(Kind::kPose, "/vio/odometry", "geometry_msgs/PoseStamped"),
            "nothing yet on /vio/odometry for 40 s (it is published as nav_msgs/Odometry, and must be "
            "geometry_msgs/PoseStamped: set pose_source:=odom odom:=/vio/odometry)");
  const std::string compressed = "set image_transport:=compressed image:=/cam/image)";
  EXPECT_THAT(word(Kind::kImage, "/cam/image", "sensor_msgs/Image"), HasSubstr(compressed)) << "transport forgotten";
  EXPECT_THAT(word(Kind::kImage, "/cam/image/compressed", "sensor_msgs/Image"), HasSubstr(compressed));
  EXPECT_THAT(word(Kind::kImage, "/cam/image/compressed/compressed", "sensor_msgs/CompressedImage"),
              HasSubstr(compressed))
      << "the suffix twice";
  EXPECT_THAT(word(Kind::kCloud, "/slam/old_points", "sensor_msgs/PointCloud2", false),
              HasSubstr("set sparse_points_v1:=/slam/old_points"));
  EXPECT_THAT(word(Kind::kCameraInfo, "/vio/odometry", "sensor_msgs/CameraInfo"),
              HasSubstr("must be sensor_msgs/CameraInfo)"));
  EXPECT_THAT(word(Kind::kPose, "/pose", "geometry_msgs/PoseStamped"),
              HasSubstr("nobody publishes it: check the remap"));
}

TEST(Diagnostics, DoNotFallSilentWhenAllImagesWereDropped) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.images_dropped = 500;
  snapshot.drops["no_depth_range"] = {498, "keyframe 4: set depth_min and depth_max", 60, 60};
  snapshot.drops["no_pose"] = {2, "no pose", 61, 61};
  const auto status = Describe(&DescribeMatching, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_EQ(status.message,
            "all 500 images were dropped, most of them: no_depth_range (keyframe 4: set depth_min and depth_max)");
  snapshot.worker.outputs.refined = 1;
  EXPECT_EQ(Describe(&DescribeMatching, snapshot).level, DiagnosticStatus::OK);
}

TEST(Diagnostics, TellLatencies) {
  MapperSnapshot snapshot = HealthyMapper();
  EXPECT_EQ(ValueOf(Describe(&DescribeMapping, snapshot), "latency of fast depth maps [ms]"), "none yet");
  for (int i = 1; i <= 101; ++i) snapshot.worker.outputs.fast_latency.Add(i);
  EXPECT_EQ(ValueOf(Describe(&DescribeMapping, snapshot), "latency of fast depth maps [ms]"),
            "median 51, 99 % 100, greatest 101 of the last 101");
}

TEST(LatencyWindow, ForgetsWhatIsLongAgo) {
  LatencyWindow window;
  for (size_t i = 0; i < 10 * LatencyWindow::kCapacity; ++i) window.Add(1000);
  for (size_t i = 0; i < LatencyWindow::kCapacity; ++i) window.Add(5);
  EXPECT_EQ(window.quantiles().max_ms, 5);
  EXPECT_EQ(window.quantiles().count, 11 * LatencyWindow::kCapacity);
}

TEST(Diagnostics, CountDropsByReasonAndWarnOfRecentOnes) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.drops["bad_pose"] = {7, "pose 1.000000000: not finite", 98, 98};
  snapshot.drops["overload"] = {9, "keyframe 2.0: the mapper is busy", 99, 99};
  auto status = Describe(&DescribeMatching, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("overload")) << "the latest";
  EXPECT_THAT(ValueOf(status, "dropped: bad_pose"), AllOf(HasSubstr("7"), HasSubstr("not finite")));
  snapshot.now_s = 200;
  status = Describe(&DescribeMatching, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK) << "long ago";
  EXPECT_THAT(ValueOf(status, "dropped: bad_pose"), HasSubstr("7"));
  // Frontends that pose keyframes only leave most images without a pose.
  snapshot = HealthyMapper();
  snapshot.drops["no_pose"] = {1000, "no pose", 99.9, 99.9};
  EXPECT_EQ(Describe(&DescribeMatching, snapshot).level, DiagnosticStatus::OK);
}

TEST(Diagnostics, WarnOfARunOfKeyframesWithoutPoints) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.worker.outputs.run_without_points = OutputStatus::kRunWithoutPoints - 1;
  snapshot.worker.outputs.no_points_reason = "reprojection (2 px) 90 %; check ~pose_is";
  auto status = Describe(&DescribeMapping, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK);
  EXPECT_THAT(ValueOf(status, "checks that remove the points of the last one"), HasSubstr("reprojection"));
  ++snapshot.worker.outputs.run_without_points;
  status = Describe(&DescribeMapping, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, AllOf(HasSubstr("the last 3 refined"), HasSubstr("reprojection"), HasSubstr("~pose_is")));
}

TEST(IncidentLog, TellsNewReasonsAtOnceAndRepeatsSeldom) {
  IncidentLog log;
  EXPECT_TRUE(log.Record(Incident{"a", "first"}, 0));
  EXPECT_FALSE(log.Record(Incident{"a", "second"}, 4.9));
  EXPECT_TRUE(log.Record(Incident{"b", "other"}, 4.9));
  EXPECT_TRUE(log.Record(Incident{"a", "third"}, 5.0));
  EXPECT_FALSE(log.Record(Incident{"a", "fourth"}, 9.9));
  const auto entries = log.entries();
  EXPECT_EQ(entries.at("a").count, 4u);
  EXPECT_EQ(entries.at("a").last_message, "fourth");
  EXPECT_EQ(entries.at("a").last_time_s, 9.9);
  EXPECT_EQ(entries.at("b").count, 1u);
}

TEST(Printable, IsUtf8WithoutNewLinesAndEscapeCodes) {
  EXPECT_EQ(Printable("keyframe 3 of \"m\u00fc\""), "keyframe 3 of \"m\u00fc\"");
  EXPECT_EQ(Printable("x\n[FATAL]: forged\x1b[2J"), "x\\x0a[FATAL]: forged\\x1b[2J");
  EXPECT_EQ(Printable("\u009b2J"), "\\xc2\\x9b2J");
  EXPECT_EQ(Printable("\x9b\xff\xc3(\xed\xa0\x80\xe2\x82"), "\\x9b\\xff\\xc3(\\xed\\xa0\\x80\\xe2\\x82");
  EXPECT_EQ(Printable("\u20ac\U0001f600"), "\u20ac\U0001f600");
}

TEST(IncidentLog, CountsTheImagesThatEnded) {
  IncidentLog log;
  log.Record(RejectedInput{"no_pose", "image 1", true}, 0);
  log.Record(RejectedInput{"sparse_empty", "cloud 1"}, 0);
  log.Record(RejectedInput{"overload", "image 2", true}, 0);
  EXPECT_EQ(log.images(), 2u);
}

/// A map at work.
MapSnapshot HealthyMap() {
  MapSnapshot snapshot;
  snapshot.now_s = 100;
  snapshot.keyframe_topic = "/acmp/keyframe_points";
  snapshot.keyframe_publishers = 2;
  snapshot.optimized_path_topic = "/slam/path";
  snapshot.optimized_path_publishers = 1;
  snapshot.mappers["/acmp/dense_mapper"] = {40, 0, 99};
  return snapshot;
}

TEST(MapDiagnostics, SayWhatIsNotInTheMapYet) {
  MapSnapshot snapshot = HealthyMap();
  EXPECT_EQ(DescribeMissing(snapshot.mappers), "");
  snapshot.mappers["/acmp/dense_mapper"].lost = 234;
  EXPECT_THAT(DescribeMissing(snapshot.mappers), HasSubstr("234 messages with points of /acmp/dense_mapper were lost"));
  snapshot.mappers["/acmp_2/dense_mapper"].images_under_way = 7;
  EXPECT_THAT(DescribeMissing(snapshot.mappers), AllOf(HasSubstr("7 images"), HasSubstr("/acmp_2/dense_mapper"),
                                                       HasSubstr("flush finishes them, if it has not since")));
  EXPECT_THAT(ValueOf(Describe(&DescribeMappers, snapshot), "/acmp_2/dense_mapper"), HasSubstr("under way then: 7"));
}

TEST(MapDiagnostics, TellWhatComesFromEachMapper) {
  MapSnapshot snapshot = HealthyMap();
  snapshot.mappers["/right/dense_mapper"] = {30, 2, 60};
  auto status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK) << "a camera that stands still has no keyframes";
  EXPECT_THAT(ValueOf(status, "/right/dense_mapper"),
              AllOf(HasSubstr("30 messages"), HasSubstr("40 s ago"), HasSubstr("2 lost")));
  snapshot.keyframe_publishers = 0;
  status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("nobody publishes /acmp/keyframe_points"));
}

}  // namespace
}  // namespace acmp
