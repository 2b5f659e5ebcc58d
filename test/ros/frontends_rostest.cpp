// One frontend's launch file, fed with what that frontend publishes, must give the depth maps that the pipeline makes
// of the same estimates as plain messages (mapping_rostest shows that those of the plain topics are the same bit by
// bit).

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>

#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/pipeline/presets.h"
#include "ros/frontend_player.h"
#include "ros/recorder.h"

namespace acmp::test::frontends_rostest {

constexpr int kWidth = 64, kHeight = 48;
constexpr size_t kKeyframes = 5;
constexpr char kPreset[] = "online";  // as frontends_rostest.test has it: all steps, in less time

std::vector<SyntheticView> MakeViews(const FrontendTraits& traits) {
  SyntheticSceneOptions scene;
  scene.width = kWidth;
  scene.height = kHeight;
  scene.keyframes = static_cast<int>(kKeyframes + traits.pose_delay);
  return MakeSyntheticScene(scene);
}

using MapsByStamp = std::map<ros::Time, KeyframeDepthPtr>;

/// What the pipeline makes of the plain messages.
MapsByStamp ExpectedMaps(const std::vector<ViewMessages>& plain) {
  MapsByStamp expected;
  DenseMapper::Callbacks callbacks;
  callbacks.on_refined = [&](const KeyframeDepthPtr& maps) {
    expected[plain.at(static_cast<size_t>(maps->frame->id)).image.header.stamp] = maps;
  };
  const DepthEngineBackend backend = MakeDepthEngine(Device::kCpu);
  DenseMapperOptions options;
  options.pipeline = MakePreset(kPreset);
  DenseMapper mapper(backend.engine.get(), options, callbacks);
  for (size_t i = 0; i < plain.size(); ++i) mapper.AddKeyframe(MakeExpectedFrame(static_cast<int64_t>(i), plain[i]));
  mapper.Flush();
  return expected;
}

/// What the mapper made of it.
struct Outcome {
  size_t maps = 0, pixels = 0, known = 0, different = 0;
  double worst = 0;  ///< relative difference of depths
};

void Compare(const sensor_msgs::Image& message, const DepthMap& expected, Outcome* outcome) {
  ASSERT_EQ(message.width, static_cast<uint32_t>(expected.width()));
  ASSERT_EQ(message.height, static_cast<uint32_t>(expected.height()));
  const auto* values = reinterpret_cast<const float*>(message.data.data());
  ++outcome->maps;
  for (size_t i = 0; i < expected.size(); ++i) {
    const float value = std::isnan(values[i]) ? 0 : values[i];  // 0: unknown
    ++outcome->pixels;
    outcome->known += value > 0;
    outcome->different += value != expected.data()[i];
    if (value > 0 && expected.data()[i] > 0) {
      outcome->worst = std::max(outcome->worst, std::abs(double{value} / double{expected.data()[i]} - 1));
    }
  }
}

/// Where the row of the table of presets goes.
std::filesystem::path RowPath(const FrontendTraits& traits) {
  std::filesystem::create_directories(ACMP_FRONTEND_RESULTS);
  return std::filesystem::path(ACMP_FRONTEND_RESULTS) / (traits.name + ".md");
}

void WriteRow(const FrontendTraits& traits, const Outcome& outcome) {
  std::ostringstream row;
  row << "| " << traits.name << " | " << outcome.maps << " of " << kKeyframes << " | " << outcome.different << " of "
      << outcome.pixels << " | " << std::setprecision(2) << outcome.worst << " |\n";
  std::cout << row.str();
  std::ofstream(RowPath(traits)) << row.str();
}

class FrontendTest : public ::testing::Test {
 protected:
  static std::string Name() {
    std::string name;
    ros::NodeHandle("~").getParam("frontend", name);
    return name;
  }

  void Run() {
    std::filesystem::remove(RowPath(traits_));
    spinner_.start();
    std::string missing;
    ASSERT_TRUE(player_.WaitForMapper(kTimeoutS, &missing)) << "nobody subscribed to" << missing;
    ASSERT_TRUE(depth_.WaitForPublisher(kTimeoutS) && pose_.WaitForPublisher(kTimeoutS));
    player_.Play();
    // A flush before all have arrived would finish early ones with fewer views.
    ASSERT_TRUE(pose_.WaitForCount(kKeyframes, kTimeoutS)) << pose_.messages().size() << " keyframes";
    std_srvs::Trigger flush;
    ASSERT_TRUE(ros::service::call("/acmp/dense_mapper/flush", flush) && flush.response.success);
    ASSERT_TRUE(depth_.WaitForCount(kKeyframes, kTimeoutS)) << depth_.messages().size() << " depth maps";
  }

  void ExpectPose(const ros::Time& stamp, const geometry_msgs::Pose& pose, const RigidTransform& correction) const {
    size_t view = 0;
    while (view + 1 < kKeyframes && player_.stamp(view) != stamp) ++view;
    const geometry_msgs::Quaternion& q = pose.orientation;
    const RigidTransform received = CheckedTransform(
        Eigen::Quaterniond(q.w, q.x, q.y, q.z), Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z));
    const RigidTransform expected = correction * player_.world_from_cam().at(view);
    // Some products of rotations and a quaternion, all in double.
    EXPECT_LT((received.matrix() - expected.matrix()).cwiseAbs().maxCoeff(), 1e-12) << stamp;
  }

  void ExpectPathToMoveTheKeyframes() {
    RigidTransform correction(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()));
    correction.translation() << 1, 2, 3;
    Recorder<nav_msgs::Path> path(nh_, "/acmp/keyframe_path");
    player_.PublishPath(correction);
    const Eigen::Vector3d first = (correction * player_.world_from_cam().front()).translation();
    ASSERT_TRUE(path.WaitUntil(
        [&](const std::vector<nav_msgs::PathConstPtr>& paths) {
          if (paths.empty() || paths.back()->poses.size() != kKeyframes) return false;
          const geometry_msgs::Point& p = paths.back()->poses.front().pose.position;
          return (Eigen::Vector3d(p.x, p.y, p.z) - first).norm() < 0.01;
        },
        kTimeoutS))
        << "the keyframes do not follow " << traits_.path_topic;
    for (const auto& pose : path.messages().back()->poses) ExpectPose(pose.header.stamp, pose.pose, correction);
  }

  ros::NodeHandle nh_;
  ros::AsyncSpinner spinner_{1};
  const FrontendTraits traits_ = FindFrontend(Name());
  FrontendPlayer player_{nh_, traits_, MakeViews(traits_)};
  Recorder<sensor_msgs::Image> depth_{nh_, "/acmp/depth/image_rect"};
  Recorder<geometry_msgs::PoseStamped> pose_{nh_, "/acmp/keyframe_pose"};
};

TEST_F(FrontendTest, MapsAreThoseOfThePlainMessages) {
  ASSERT_NO_FATAL_FAILURE(Run());
  const MapsByStamp expected = ExpectedMaps(player_.plain());
  ASSERT_EQ(expected.size(), kKeyframes);
  Outcome outcome;
  for (const auto& message : depth_.messages()) {
    ASSERT_EQ(expected.count(message->header.stamp), 1u) << message->header.stamp << ": not an image's stamp";
    EXPECT_EQ(message->header.frame_id, traits_.output_frame.empty() ? traits_.image_frame : traits_.output_frame);
    ASSERT_NO_FATAL_FAILURE(Compare(*message, expected.at(message->header.stamp)->depth, &outcome));
  }
  WriteRow(traits_, outcome);
  EXPECT_EQ(outcome.maps, kKeyframes);
  EXPECT_GT(outcome.known, outcome.pixels / 2) << "there must be something to compare";
  // Also where poses went through another frame and are rounded differently by 1e-16: matching takes them as float
  // numbers, whose steps are 1e8 times as large. (An extrinsic that is a millimetre off changes every pixel.)
  EXPECT_EQ(outcome.different, 0u);

  for (const auto& message : pose_.messages()) {
    EXPECT_EQ(message->header.frame_id, traits_.world_frame);
    ExpectPose(message->header.stamp, message->pose, RigidTransform::Identity());
  }
  if (!traits_.path_topic.empty()) ExpectPathToMoveTheKeyframes();
}

}  // namespace acmp::test::frontends_rostest
