// What /diagnostics and the log say, of snapshots; what is counted and told of incidents.

#include "acmp_mapping/ros/diagnostics.h"

#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/error_text.h"

namespace acmp {
namespace {

using Kind = InputStatus::Kind;
using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;

template <class Snapshot>
DiagnosticStatusWrapper Describe(void (*describer)(const Snapshot&, DiagnosticStatusWrapper*),
                                 const Snapshot& snapshot) {
  DiagnosticStatusWrapper status;
  describer(snapshot, &status);
  return status;
}

std::string ValueOf(const DiagnosticStatusWrapper& status, const std::string& key) {
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

using Change = std::function<void(MapperSnapshot*)>;

Change SetInput(size_t index, const InputStatus& status) {
  return [=](MapperSnapshot* s) { s->inputs[index] = status; };
}

Change Drop(const std::string& reason, const IncidentLog::Entry& entry, uint64_t images_dropped = 0) {
  return [=](MapperSnapshot* s) { s->drops[reason] = entry, s->images_dropped = images_dropped; };
}

Change WithoutPoints(uint64_t keyframes) {
  return [=](MapperSnapshot* s) {
    s->worker.outputs.run_without_points = keyframes;
    s->worker.outputs.no_points_reason = "reprojection";
  };
}

/// Each status with the level and words that it must have after a change of a healthy mapper.
TEST(MapperDiagnostics, SayWhatIsWrong) {
  constexpr auto kOk = DiagnosticStatus::OK, kWarn = DiagnosticStatus::WARN;
  constexpr uint64_t kRun = OutputStatus::kRunWithoutPoints;
  const Change ended = [](auto* s) {
    s->now_s = 200;
    for (InputStatus& input : s->inputs) input.publishers = 0;
  };
  const Change wrong_stamps = [](auto* s) {
    s->worker.pose_checks.stamp_offset_s = 0.0312;
    s->worker.pose_checks.contradiction = 0.004;
  };
  const Change latencies = [](auto* s) {
    for (int i = 1; i <= 101; ++i) s->worker.outputs.fast_latency.Add(i);
  };
  const char latency[] = "latency of fast depth maps [ms]", checks[] = "checks that remove the points of the last one";
  const struct {
    void (*describe)(const MapperSnapshot&, DiagnosticStatusWrapper*);
    Change change;
    signed char level;
    const char *message, *key = nullptr, *value = nullptr;
  } cases[] = {
      {&DescribeInputs, [](auto*) {}, kOk, "all inputs arrive"},
      {&DescribeInputs, SetInput(1, {Kind::kCameraInfo, "/info", 0, 0, 60}), kWarn,
       "nothing yet on /info for 40 s (nobody publishes it: check the remap)"},
      {&DescribeInputs, SetInput(2, {Kind::kPose, "/slam/pose", 1, 500, 88}), kWarn,
       "nothing on /slam/pose for 12 s (1 publisher(s))", "/slam/pose", "500 received: nothing on /slam/pose for 12 s"},
      {&DescribeInputs, SetInput(3, {Kind::kCloud, "/points", 0, 0, 60, false}), kOk, "all inputs arrive", "/points",
       "nobody publishes"},  // not needed when the depth range is given
      {&DescribeInputs, SetInput(3, {Kind::kMask, "/camera/maks", 0, 0, 60, false, "", "", 0, true}), kWarn,
       "nothing yet on /camera/maks for 40 s"},  // the user has named it
      {&DescribeInputs, SetInput(3, {Kind::kMask, "/camera/mask", 0, 1, 60, false, "", "", 0, true}), kOk,
       "all inputs arrive"},  // it has come
      {&DescribeInputs, [](auto* s) { s->paused = true; }, kWarn, "paused"},
      {&DescribeInputs, ended, kWarn, "after 500 messages nobody publishes it any more: a recording has ended"},

      {&DescribeMatching, Drop("overload", {9, "busy", 99, 99}), kWarn, "overload: busy", "dropped: overload",
       "9 (busy)"},
      {&DescribeMatching, Drop("bad_pose", {7, "not finite", 60, 60}), kOk, "400 images", "dropped: bad_pose",
       "7 (not finite)"},                                                                      // long ago
      {&DescribeMatching, Drop("no_pose", {1000, "no pose", 99.9, 99.9}), kOk, "400 images"},  // usual
      {&DescribeMatching, Drop("no_depth_range", {498, "set depth_min", 60, 60}, 500), kWarn,
       "all 500 images were dropped, most of them: no_depth_range (set depth_min)"},
      {&DescribeMatching, [](auto* s) { s->images_dropped = 500, s->worker.outputs.refined = 1; }, kOk, "400 images"},
      {&DescribeMatching,
       [](auto* s) {
         s->last_gap = PoseGap{1500000000, 33400000, ""};
       },
       kOk, "400 images", "last image without a pose",
       "1.500000000: nearest is 33.4 ms away on /slam/pose; ~sync_tolerance is 1 ms"},

      {&DescribeMapping, wrong_stamps, kWarn, "taken 31 ms before", "poses contradict the images by [% of the depth]",
       "0.4"},
      {&DescribeMapping, [](auto* s) { s->worker.pose_checks.stamp_offset_s = -0.02; }, kWarn, "taken 20 ms after"},
      {&DescribeMapping, [](auto* s) { s->worker.rig = "the baseline is in millimetres"; }, kWarn, "millimetres"},
      {&DescribeMapping, [](auto* s) { s->worker.distortion = "radial distortion"; }, kWarn, "radial distortion"},
      {&DescribeMapping, [](auto* s) { s->convention_warning = "~pose_is: T_cam_world fits"; }, kWarn, "T_cam_world",
       "sparse points in front of the first cameras [%]", "90"},
      {&DescribeMapping, [](auto*) {}, kOk, "mapping on cpu", latency, "none yet"},
      {&DescribeMapping, latencies, kOk, "mapping on cpu", latency,
       "median 51, 99 % 100, greatest 101 of the last 101"},
      {&DescribeMapping, WithoutPoints(kRun - 1), kOk, "mapping on cpu", checks, "reprojection"},
      {&DescribeMapping, WithoutPoints(kRun), kWarn, "the last 3 refined keyframes have no points"}};
  for (const auto& c : cases) {
    MapperSnapshot snapshot = HealthyMapper();
    c.change(&snapshot);
    const DiagnosticStatusWrapper status = Describe(c.describe, snapshot);
    EXPECT_EQ(status.level, c.level) << c.message;
    EXPECT_THAT(status.message, HasSubstr(c.message));
    if (c.key) {
      EXPECT_THAT(ValueOf(status, c.key), HasSubstr(c.value));
    }
  }
}

TEST(MapperDiagnostics, TheLatestDropIsToldFirst) {
  MapperSnapshot snapshot = HealthyMapper();
  Drop("bad_pose", {7, "not finite", 98, 98})(&snapshot);
  Drop("overload", {9, "busy", 99, 99})(&snapshot);
  EXPECT_THAT(Describe(&DescribeMatching, snapshot).message, HasSubstr("overload: busy"));
}

TEST(MapperDiagnostics, NameMissingInputsInTheLog) {
  EXPECT_EQ(DescribeMissing(HealthyMapper()), "");
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.inputs[0] = {Kind::kImage, "/cam/image", 0, 0, 97};
  EXPECT_EQ(DescribeMissing(snapshot), "") << "3 s are no long wait";
  snapshot.inputs[0].last_received_s = 88;
  snapshot.inputs[2].last_received_s = 90;  // the frontend has stopped, the camera info goes on
  EXPECT_THAT(DescribeMissing(snapshot),
              HasAll("nothing yet on /cam/image for 12 s", "; nothing on /slam/pose for 10 s"));
  snapshot.paused = true;
  EXPECT_EQ(DescribeMissing(snapshot), "");
  snapshot = HealthyMapper();
  snapshot.now_s = 200;
  EXPECT_EQ(DescribeMissing(snapshot), "") << "a recording has ended: no use of repeating that";
  snapshot = HealthyMapper();
  snapshot.inputs.push_back({Kind::kSourceImage, "/right/image", 0, 0, 88, false});
  EXPECT_THAT(DescribeMissing(snapshot), HasSubstr("/right/image for 12 s")) << "somebody has asked for it";
  snapshot = HealthyMapper();
  snapshot.waiting_images = 7;
  snapshot.waiting_for = "T_body_cam is not known";
  EXPECT_EQ(DescribeMissing(snapshot), "7 images wait: T_body_cam is not known");
}

TEST(MapperDiagnostics, ATopicOfAnotherTypeIsNamedWithWhatToSet) {
  const std::map<std::string, std::string> published = {{"/vio/odometry", "nav_msgs/Odometry"},
                                                        {"/cam/image/compressed", "sensor_msgs/CompressedImage"},
                                                        {"/slam/old_points", "sensor_msgs/PointCloud"}};
  const std::string compressed = "set image_transport:=compressed image:=/cam/image)";
  const struct {
    Kind kind;
    std::string topic, type, word;
  } cases[] = {
      {Kind::kPose, "/vio/odometry", "geometry_msgs/PoseStamped",
       "nothing yet on /vio/odometry for 40 s (it is published as nav_msgs/Odometry, and must be "
       "geometry_msgs/PoseStamped: set pose_source:=odom odom:=/vio/odometry)"},
      {Kind::kImage, "/cam/image", "sensor_msgs/Image", compressed},
      {Kind::kImage, "/cam/image/compressed", "sensor_msgs/Image", compressed},
      {Kind::kImage, "/cam/image/compressed/compressed", "sensor_msgs/CompressedImage", compressed},
      {Kind::kCloud, "/slam/old_points", "sensor_msgs/PointCloud2", "set sparse_points_v1:=/slam/old_points"},
      {Kind::kCameraInfo, "/vio/odometry", "sensor_msgs/CameraInfo", "must be sensor_msgs/CameraInfo)"},
      {Kind::kPose, "/pose", "geometry_msgs/PoseStamped",
       "nobody publishes it; what could be taken is /vio/odometry: set pose_source:=odom odom:=/vio/odometry)"},
      {Kind::kKeyframe, "/keyframe", "acmp_mapping/Keyframe", "nobody publishes it: check the remap"}};
  for (const auto& [kind, topic, type, word] : cases) {
    MapperSnapshot snapshot = HealthyMapper();
    snapshot.inputs = {{kind, topic, 0, 0, 60, kind != Kind::kCloud, type}};
    AddAdvice(published, &snapshot.inputs);
    EXPECT_THAT(DescribeMissing(snapshot), HasSubstr(word));
    EXPECT_EQ(DescribeMissing(snapshot), Describe(&DescribeInputs, snapshot).message);
  }
}

TEST(MapperDiagnostics, WhatIsPublishedAndLooksLikeAMisspelledNameIsNamed) {
  const std::map<std::string, std::string> published = {
      {"/camera/mask", "sensor_msgs/Image"},
      {"/camera/image_raw", "sensor_msgs/Image"},
      {"/depth/image_raw/compressedDepth", "sensor_msgs/CompressedImage"},
      {"/camera/camera_info", "sensor_msgs/CameraInfo"},
      {"/robot/cam/image_color", "sensor_msgs/Image"}};
  const struct {
    Kind kind;
    std::string topic, type, word;
  } cases[] = {
      {Kind::kMask, "/camera/maks", "sensor_msgs/Image", "nobody publishes it, but /camera/mask: set mask:="},
      {Kind::kImage, "/camera/imag_raw", "sensor_msgs/Image", "but /camera/image_raw: set "},
      {Kind::kCameraInfo, "/camera/camrea_info", "sensor_msgs/CameraInfo", "set camera_info:=/camera/camera_info"},
      {Kind::kImage, "/robot/acmp/cam/image_color", "sensor_msgs/Image", "image:=/robot/cam/image_color"},
      {Kind::kPriorDepth, "/depth/image_raw", "sensor_msgs/Image",
       "republish compressedDepth in:=/depth/image_raw raw out:="},
      {Kind::kPriorDepth, "/somewhere/else/entirely", "sensor_msgs/Image", "nobody publishes it: check"}};
  for (const auto& [kind, topic, type, word] : cases) {
    MapperSnapshot snapshot = HealthyMapper();
    const char* name = kind == Kind::kMask ? "mask" : "camera_info";
    snapshot.inputs = {{kind, topic, 0, 0, 60, false, type, "", 0, true, name}};
    AddAdvice(published, &snapshot.inputs);
    EXPECT_THAT(DescribeMissing(snapshot), HasSubstr(word));
  }
}

TEST(MapperDiagnostics, WhatIsTakenAlreadyOrWasNotAskedForIsNoAdvice) {
  const std::map<std::string, std::string> published = {{"/slam/sparse_points", "sensor_msgs/PointCloud2"}};
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.inputs = {{Kind::kCloud, "/slam/sparse_points_v1", 0, 0, 60, false, "sensor_msgs/PointCloud"}};
  AddAdvice(published, &snapshot.inputs);
  EXPECT_EQ(DescribeMissing(snapshot), "") << "nobody has named it";
  snapshot.inputs[0].is_named = true;
  snapshot.inputs.push_back({Kind::kCloud, "/slam/sparse_points", 1, 5, 99, false, "sensor_msgs/PointCloud2"});
  AddAdvice(published, &snapshot.inputs);
  EXPECT_THAT(DescribeMissing(snapshot), HasSubstr("nobody publishes it: check"));
}

TEST(MapperDiagnostics, OutputsOfMappersAreNoAdvice) {
  std::map<std::string, std::string> published = {{"/acmp_2/keyframe_depth", "acmp_mapping/KeyframeDepth"},
                                                  {"/acmp_2/keyframe_pose", "geometry_msgs/PoseStamped"},
                                                  {"/acmp_2/depth/image_raw", "sensor_msgs/Image"},
                                                  {"/acmp_2/depth/image_raw/compressed", "sensor_msgs/CompressedImage"},
                                                  {"/acmp_2/face_left/rgb/image_rect_color", "sensor_msgs/Image"},
                                                  {"/acmp_2/rgb/camera_info", "sensor_msgs/CameraInfo"},
                                                  {"/acmp_2/points", "sensor_msgs/PointCloud2"},
                                                  {"/maps/distance_slice", "sensor_msgs/PointCloud2"},
                                                  {"/maps/map_points", "sensor_msgs/PointCloud2"},
                                                  {"/maps/keyframe_path", "nav_msgs/Path"}};
  MapperSnapshot snapshot = HealthyMapper();
  const auto said_of = [&](Kind kind, const std::string& topic, const std::string& type) {
    snapshot.inputs = {{kind, topic, 0, 0, 60, true, type, "", 0, true}};
    AddAdvice(published, &snapshot.inputs);
    return DescribeMissing(snapshot);
  };
  const struct {
    Kind kind;
    std::string topic, type;
  } cases[] = {{Kind::kImage, "/acmp/depth/image_raw", "sensor_msgs/Image"},
               {Kind::kCameraInfo, "/acmp_2/camera_info", "sensor_msgs/CameraInfo"},
               {Kind::kPose, "/acmp_2/pose", "geometry_msgs/PoseStamped"},
               {Kind::kCloud, "/maps/points", "sensor_msgs/PointCloud2"}};
  for (const auto& [kind, topic, type] : cases) {
    EXPECT_THAT(said_of(kind, topic, type), HasSubstr("nobody publishes it: check")) << topic;
  }
  published["/acmp_2/camera/image_raw"] = "sensor_msgs/Image";
  EXPECT_THAT(said_of(Kind::kImage, "/acmp_2/camera/imag_raw", "sensor_msgs/Image"),
              HasSubstr("but /acmp_2/camera/image_raw"))
      << "a camera in the namespace of a mapper";
  published["/keyframe_depth"] = "acmp_mapping/KeyframeDepth";
  published["/rgb/image_raw"] = "sensor_msgs/Image";
  EXPECT_THAT(said_of(Kind::kImage, "/rgb/image", "sensor_msgs/Image"), HasSubstr("but /rgb/image_raw"))
      << "a camera beside a mapper in the root namespace";
  EXPECT_THAT(said_of(Kind::kPose, "/acmp_2/rgb/camera_info", "geometry_msgs/PoseStamped"),
              HasSubstr("it is published as sensor_msgs/CameraInfo"))
      << "what the user has named is told";
}

TEST(MapperDiagnostics, SayHowFarImagesAreFromPoses) {
  MapperSnapshot snapshot = HealthyMapper();
  snapshot.pose_use = {10, 20, 3, 12500000};
  EXPECT_THAT(ValueOf(Describe(&DescribeMatching, snapshot), "stamps of images and poses"),
              HasAll("10 images have", "20 one between", "12.5 ms", "~sync_tol"));
}

TEST(MapperDiagnostics, DropsAreCountedByReason) {
  MapperSnapshot snapshot = HealthyMapper();
  EXPECT_EQ(DescribeDrops(snapshot), "");
  snapshot.drops["no_pose"].images = 12;
  snapshot.drops["overload"].images = 30;
  snapshot.drops["bad_pose"].count = 7;  // ended no image
  EXPECT_EQ(DescribeDrops(snapshot), " (dropped: 30 overload, 12 no_pose)");
}

TEST(MapperDiagnostics, DistortionThatNobodyToldIsNamed) {
  LensDistortion none, some;
  some.model = LensDistortion::Model::kBrownConrady;
  EXPECT_EQ(DescribeDistortion(5, 640, none), "");
  EXPECT_THAT(DescribeDistortion(-15.24, 640, none), HasAll("15.2 px of 640 too far in", "D of"));
  EXPECT_THAT(DescribeDistortion(15, 640, some), HasAll("too far out", "~rectified"));
}

TEST(MapperDiagnostics, DistortionThatACalibrationLeavesIsToldWithItsCoefficients) {
  CameraCalibration calibration;
  calibration.camera = {640, 480, 500, 500, 319.5, 239.5};  // the corner lies 399.4 px or 0.799 from the middle
  EXPECT_EQ(DescribeCameraErrors({0.001, 0, 0.01}, calibration), "");
  EXPECT_THAT(DescribeCameraErrors({0.01, 0, 0.0104}, calibration),
              HasAll("2.5 px of 640", "10 ms", "[0.01, 0, 0, 0, 0]", "plumb_bob"));
  calibration.distortion = {LensDistortion::Model::kBrownConrady, {-0.2, 0, 0, 0, 0}};
  EXPECT_THAT(DescribeCameraErrors({0.01, 0, 0}, calibration), HasSubstr("[-0.1"));
}

TEST(LatencyWindow, ForgetsWhatIsLongAgo) {
  LatencyWindow window;
  for (size_t i = 0; i < 10 * LatencyWindow::kCapacity; ++i) window.Add(1000);
  for (size_t i = 0; i < LatencyWindow::kCapacity; ++i) window.Add(5);
  EXPECT_EQ(window.quantiles().max_ms, 5);
  EXPECT_EQ(window.quantiles().count, 11 * LatencyWindow::kCapacity);
}

TEST(IncidentLog, TellsNewReasonsAtOnceRepeatsSeldomAndCountsTheImagesThatEnded) {
  IncidentLog log;
  EXPECT_TRUE(log.Record(RejectedInput{"a", "first"}, 0));
  EXPECT_FALSE(log.Record(RejectedInput{"a", "second"}, 4.9));
  EXPECT_TRUE(log.Record(RejectedInput{"b", "other", true}, 4.9));
  EXPECT_TRUE(log.Record(RejectedInput{"a", "third", false}, 5.0));
  EXPECT_FALSE(log.Record(RejectedInput{"a", "fourth", true}, 9.9));
  EXPECT_EQ(log.entries().at("a").count, 4u);
  EXPECT_EQ(log.entries().at("a").last_message, "fourth");
  EXPECT_EQ(log.entries().at("a").last_time_s, 9.9);
  EXPECT_EQ(log.entries().at("b").count, 1u);
  EXPECT_EQ(log.images(), 2u);
}

TEST(Printable, IsUtf8WithoutNewLinesAndEscapeCodes) {
  EXPECT_EQ(Printable("keyframe 3 of \"m\u00fc\""), "keyframe 3 of \"m\u00fc\"");
  EXPECT_EQ(Printable("x\n[FATAL]: forged\x1b[2J"), "x\\x0a[FATAL]: forged\\x1b[2J");
  EXPECT_EQ(Printable("\u009b2J"), "\\xc2\\x9b2J");
  EXPECT_EQ(Printable("\x9b\xff\xc3(\xed\xa0\x80\xe2\x82"), "\\x9b\\xff\\xc3(\\xed\\xa0\\x80\\xe2\\x82");
  EXPECT_EQ(Printable("\u20ac\U0001f600"), "\u20ac\U0001f600");
}

TEST(MapDiagnostics, AnOptimizedPathThatTheUserHasNamedAndNobodyPublishesIsTold) {
  MapSnapshot snapshot;
  snapshot.map.keyframes = 3;
  snapshot.optimized_path_topic = "/slam/pathh";
  EXPECT_EQ(Describe(&DescribeMap, snapshot).level, DiagnosticStatus::OK) << "not named";
  snapshot.optimized_path_is_named = true;
  DiagnosticStatusWrapper status = Describe(&DescribeMap, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("/slam/pathh"));
  snapshot.map.paths = 1;
  EXPECT_EQ(Describe(&DescribeMap, snapshot).level, DiagnosticStatus::OK) << "it has been there";
}

TEST(MapDiagnostics, TellWhatComesFromEachMapperAndWhatIsMissing) {
  MapSnapshot snapshot;
  snapshot.now_s = 100;
  snapshot.keyframe_topic = "/points";
  snapshot.keyframe_publishers = 2;
  snapshot.mappers["/left"] = {40, 0, 99};
  EXPECT_EQ(DescribeMissing(snapshot.mappers), "");
  snapshot.mappers["/right"] = {30, 234, 60, 7};
  DiagnosticStatusWrapper status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK) << "a camera that stands still has no keyframes";
  EXPECT_EQ(ValueOf(status, "/right"), "30 messages, the last 40 s ago; 234 lost; images under way then: 7");
  EXPECT_THAT(DescribeMissing(snapshot.mappers),
              AllOf(HasSubstr("234 messages with points of /right were lost"), HasSubstr("7 images"),
                    HasSubstr("flush finishes them"), Not(HasSubstr("/left"))));
  snapshot.keyframe_publishers = 0;
  status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("nobody publishes /points"));
}

}  // namespace
}  // namespace acmp
