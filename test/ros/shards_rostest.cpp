// Two mapper processes that share the keyframes of the same topics, and a node that merges their maps, against one
// mapper: every depth map and the whole map must be the same, bit by bit. And one whose peer is not there.

#include <algorithm>
#include <map>
#include <set>

#include <acmp_mapping/KeyframePoints.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>

#include "ros/mapper_control.h"

namespace acmp::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kTimeoutS = 120;
constexpr size_t kViews = 25;
constexpr uint32_t kMappers = 4;
constexpr size_t kBurst = 5;   ///< views sent at once; divides kViews
constexpr size_t kRounds = 2;  ///< of the scene, as a bag that loops
constexpr size_t kKeyframes = kRounds * kViews;

bool Call(const std::string& service) {
  std_srvs::Trigger trigger;
  return ros::service::call(service, trigger) && trigger.response.success;
}

/// Waits until each has as many subscribers, which are all that there will be.
bool WaitForSubscribers(const std::vector<const ros::Publisher*>& publishers, uint32_t count) {
  const auto connected = [count](const ros::Publisher* publisher) { return publisher->getNumSubscribers() == count; };
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
  while (!std::all_of(publishers.begin(), publishers.end(), connected)) {
    if (ros::WallTime::now() > end) return false;
    ros::WallDuration(0.05).sleep();
  }
  return true;
}

/// A mapper in a namespace, seen from outside.
struct Mapper {
  explicit Mapper(const std::string& mapper_ns)
      : ns(mapper_ns), pose(nh, ns + "/keyframe_pose"), depth(nh, ns + "/depth/image_rect") {}

  bool Flush() const { return Call(ns + "/dense_mapper/flush"); }

  /// By stamp; as many of each as there were rounds.
  std::multimap<ros::Time, sensor_msgs::ImageConstPtr> Depth() {
    std::multimap<ros::Time, sensor_msgs::ImageConstPtr> by_stamp;
    for (const auto& message : depth.messages()) by_stamp.emplace(message->header.stamp, message);
    return by_stamp;
  }

  ros::NodeHandle nh;
  const std::string ns;
  Recorder<geometry_msgs::PoseStamped> pose;
  Recorder<sensor_msgs::Image> depth;
};

/// One run, shared by all cases.
struct Session {
  ros::NodeHandle nh;
  ros::AsyncSpinner spinner{1};
  const std::vector<ViewMessages> views = MakeSmallScene(kViews);
  ScenePlayer player{nh};
  Mapper single{"/single"}, shard_0{"/shard_0"}, shard_1{"/shard_1"}, lonely{"/lonely"};
  Recorder<acmp_mapping::KeyframePoints> points{nh, "/keyframe_points"};
  Recorder<sensor_msgs::PointCloud2> merged_map{nh, "/map_points"};
  Recorder<sensor_msgs::PointCloud2> single_map{nh, "/single/map_points"};
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics{nh, "/diagnostics"};
  std::string failure;

  Session() {
    spinner.start();
    failure = Run();
  }

  /// Waits until a value of a status ("a/node: task") is as it should.
  bool WaitForDiagnostic(const std::string& name, const std::string& key,
                         const std::function<bool(const std::string&)>& holds) {
    return diagnostics.WaitUntil(
        [&](const auto& arrays) {
          for (const auto& array : arrays) {
            for (const auto& status : array->status) {
              if (status.name != name) continue;
              for (const auto& value : status.values) {
                if (value.key == key && holds(value.value)) return true;
              }
            }
          }
          return false;
        },
        kTimeoutS);
  }
  bool WaitForDiagnostic(const std::string& name, const std::string& key, const std::string& part) {
    return WaitForDiagnostic(name, key,
                             [&](const std::string& value) { return value.find(part) != std::string::npos; });
  }

  std::string Run() {
    if (!WaitForSubscribers({&player.image, &player.camera_info, &player.pose, &player.sparse_points}, kMappers))
      return "not all mappers have subscribed";
    for (Mapper* mapper : {&single, &shard_0, &shard_1, &lonely}) {
      if (!mapper->pose.WaitForPublisher(kTimeoutS) || !mapper->depth.WaitForPublisher(kTimeoutS) ||
          !ros::service::waitForService(mapper->ns + "/dense_mapper/flush", ros::Duration(kTimeoutS))) {
        return mapper->ns + " is not there";
      }
    }
    // The estimates' topic is connected in both directions.
    if (!WaitForPeers()) return "the shards do not hear each other";
    if (!points.WaitForPublisher(kTimeoutS, 2) || !merged_map.WaitForPublisher(kTimeoutS)) return "no map_merger";

    for (size_t sent = 0; sent < kKeyframes;) {
      // No more than the queues of all inputs hold while a mapper blocks: clouds are the first that would be lost.
      for (size_t i = 0; i < kBurst; ++i) player.Publish(views[sent++ % kViews]);
      // A view is in its mapper when its fast map is there.
      if (!single.pose.WaitForCount(sent, kTimeoutS) || !shard_0.pose.WaitForCount((sent + 1) / 2, kTimeoutS) ||
          !shard_1.pose.WaitForCount(sent / 2, kTimeoutS) || !lonely.pose.WaitForCount(sent / 2, kTimeoutS)) {
        return "fast maps are missing";
      }
    }
    // First the one that has surely got the last view, since it is its own: the other follows it.
    for (const Mapper* mapper : {&single, &shard_1, &shard_0, &lonely}) {
      if (!mapper->Flush()) return "flush failed: " + mapper->ns;
    }
    if (!WaitForDiagnostic("map_merger: map", "keyframes", std::to_string(kKeyframes)))
      return "the map is not complete";
    if (!Call("/map_merger/publish_map") || !Call("/single/dense_mapper/publish_map")) return "publish_map failed";
    if (!merged_map.WaitForCount(1, kTimeoutS) || !single_map.WaitForCount(1, kTimeoutS)) return "no map";
    if (!single.depth.WaitForCount(kKeyframes, kTimeoutS) || !shard_0.depth.WaitForCount(kKeyframes / 2, kTimeoutS) ||
        !shard_1.depth.WaitForCount(kKeyframes / 2, kTimeoutS) ||
        !lonely.depth.WaitForCount(kKeyframes / 2, kTimeoutS)) {
      return "refined maps are missing";
    }
    return points.WaitForCount(kKeyframes, kTimeoutS) ? "" : "keyframe_points are missing";
  }

  bool WaitForPeers() {
    const auto heard = [](const std::string& value) { return value.rfind("0 messages", 0) != 0; };
    return WaitForDiagnostic("shard_0/dense_mapper: shards", "shard 1", heard) &&
           WaitForDiagnostic("shard_1/dense_mapper: shards", "shard 0", heard);
  }
};

class ShardsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { session_ = new Session(); }
  static void TearDownTestSuite() { delete session_; }
  void SetUp() override { ASSERT_EQ(session_->failure, ""); }
  static Session& session() { return *session_; }

 private:
  static Session* session_;
};
Session* ShardsTest::session_ = nullptr;

TEST_F(ShardsTest, EachTakesEverySecondKeyframe) {
  std::set<uint64_t> numbers;
  for (const auto& message : session().points.messages()) {
    EXPECT_EQ(message->shard_count, 2);
    EXPECT_EQ(message->shard_index, message->number % 2);
    EXPECT_EQ(message->dropped, "");
    ASSERT_LT(message->number, kKeyframes);
    EXPECT_EQ(message->header.stamp, session().views[message->number % kViews].image.header.stamp);
    EXPECT_EQ(message->header.frame_id, kWorldFrame);
    // Refined when the camera has hardly moved, the first one has none that its two neighbours confirm in 64 x 48 px.
    if (message->number % kViews > 0) {
      EXPECT_GT(message->points.width, 0u) << message->number;
    }
    numbers.insert(message->number);
  }
  EXPECT_EQ(numbers.size(), kKeyframes);
}

TEST_F(ShardsTest, DepthMapsAreThoseOfOneMapper) {
  const auto expected = session().single.Depth();
  auto depth = session().shard_0.Depth();
  const auto others = session().shard_1.Depth();
  EXPECT_EQ(depth.size(), kKeyframes / 2);
  depth.insert(others.begin(), others.end());
  ASSERT_EQ(expected.size(), kKeyframes);
  ASSERT_EQ(depth.size(), kKeyframes);
  for (const auto& [stamp, message] : expected) {
    ASSERT_EQ(depth.count(stamp), kRounds) << stamp;
    // The rounds of one mapper are equal, too.
    for (auto [it, end] = depth.equal_range(stamp); it != end; ++it) EXPECT_TRUE(it->second->data == message->data);
  }
}

TEST_F(ShardsTest, TheMergedMapIsThatOfOneMapper) {
  const auto expected = session().single_map.messages().back();
  const auto merged = session().merged_map.messages().back();
  EXPECT_GT(expected->width, 100u);
  EXPECT_EQ(merged->header.frame_id, expected->header.frame_id);
  EXPECT_EQ(merged->header.stamp, expected->header.stamp);
  EXPECT_EQ(merged->width, expected->width);
  EXPECT_TRUE(merged->data == expected->data) << "the same points, bit by bit";
  RecordProperty("points", std::to_string(merged->width));
}

TEST_F(ShardsTest, ALoopClosureMovesTheMergedMapAsThatOfOneMapper) {
  const size_t before = session().merged_map.messages().size();
  const auto old_map = session().merged_map.messages().back();
  nav_msgs::Path path;
  for (size_t i = 0; i < kViews; i += 2) {  // the others follow the one before
    geometry_msgs::PoseStamped pose = session().views[i].pose;
    pose.pose.position.x += 0.01 * static_cast<double>(i);
    path.poses.push_back(pose);
  }
  ros::Publisher publisher = session().nh.advertise<nav_msgs::Path>("/optimized_path", 1);
  // Not two of the five: those may be shards, and the map that is compared would never hear of the path.
  ASSERT_TRUE(WaitForSubscribers({&publisher}, kMappers + 1)) << "the mappers and the map_merger";
  publisher.publish(path);
  for (const char* map : {"map_merger: map", "single/dense_mapper: map"}) {
    ASSERT_TRUE(session().WaitForDiagnostic(map, "loop corrections (paths that moved keyframes)", "1")) << map;
  }
  ASSERT_TRUE(Call("/map_merger/publish_map") && Call("/single/dense_mapper/publish_map"));
  ASSERT_TRUE(session().merged_map.WaitForCount(before + 1, kTimeoutS));
  ASSERT_TRUE(session().single_map.WaitForCount(before + 1, kTimeoutS));
  const auto merged = session().merged_map.messages().back();
  EXPECT_FALSE(merged->data == old_map->data) << "nothing has moved";
  EXPECT_TRUE(merged->data == session().single_map.messages().back()->data) << "the same points, bit by bit";
}

TEST_F(ShardsTest, AShardWhosePeerIsNotThereMapsItsOwnKeyframesAndSaysSo) {
  EXPECT_EQ(session().lonely.Depth().size(), kKeyframes / 2);
  EXPECT_TRUE(session().WaitForDiagnostic("lonely/dense_mapper: matching", "dropped: peer_estimate_missing",
                                          "which shard 0 of 2 did not send in time"));
}

TEST_F(ShardsTest, TheOthersMissNothing) {
  session().diagnostics.Clear();
  ASSERT_TRUE(session().WaitForDiagnostic("map_merger: shards", "keyframes missing", "0"));
  ASSERT_TRUE(session().WaitForDiagnostic("shard_0/dense_mapper: map", "keyframes", "25"));
  ASSERT_TRUE(session().WaitForDiagnostic("shard_1/dense_mapper: map", "keyframes", "25"));
  for (const auto& array : session().diagnostics.messages()) {
    for (const auto& status : array->status) {
      if (status.name.find("lonely") != std::string::npos) continue;
      for (const auto& value : status.values) {
        EXPECT_EQ(value.key.find("dropped"), std::string::npos) << status.name << ": " << value.key << value.value;
      }
    }
  }
}

// The last one, since it leaves incidents in the diagnostics and an empty map.
TEST_F(ShardsTest, TheMapNodeRefusesWhatCannotBeAndSaysSo) {
  ros::Publisher publisher = session().nh.advertise<acmp_mapping::KeyframePoints>("/keyframe_points", 10);
  ASSERT_TRUE(WaitForSubscribers({&publisher}, 2)) << "the map_merger and the recorder";
  const auto last = session().points.messages().back();
  acmp_mapping::KeyframePoints twice = *last;
  twice.number = kKeyframes;
  publisher.publish(twice);
  acmp_mapping::KeyframePoints no_shard = *last;
  no_shard.shard_index = 2;
  publisher.publish(no_shard);
  acmp_mapping::KeyframePoints no_pose = *last;
  no_pose.number = kKeyframes;
  no_pose.header.stamp += ros::Duration(1000);
  no_pose.T_world_cam.fill(0);
  publisher.publish(no_pose);
  EXPECT_TRUE(session().WaitForDiagnostic("map_merger: shards", "incidents: keyframe_twice", "number 50, of shard"));
  EXPECT_TRUE(session().WaitForDiagnostic("map_merger: shards", "incidents: bad_keyframe", "T_world_cam"));
  session().diagnostics.Clear();
  EXPECT_TRUE(session().WaitForDiagnostic("map_merger: map", "keyframes", "50"));
  EXPECT_TRUE(Call("/map_merger/reset"));
  EXPECT_TRUE(session().WaitForDiagnostic("map_merger: map", "keyframes",
                                          [](const std::string& value) { return value == "0"; }));
}

}  // namespace
}  // namespace acmp::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "shards_rostest");
  return RUN_ALL_TESTS();
}
