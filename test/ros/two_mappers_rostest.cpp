// Two mappers with a camera each send their points to one map: it must be the union of the two maps that the mappers
// would have alone.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include <acmp_mapping/KeyframePoints.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::two_mappers_rostest {

constexpr size_t kViews = 6;  ///< of each camera
constexpr double kVoxelSize = 0.05;
constexpr char kLeft[] = "/dense_mapper", kRight[] = "/right/dense_mapper";

/// Two cameras that look at the same room from different places, with stamps of their own.
std::vector<ViewMessages> ViewsOf(size_t camera) {
  const std::vector<ViewMessages> all = MakeSmallScene(2 * kViews, 1000, 96);
  std::vector<ViewMessages> views;
  for (size_t i = 0; i < kViews; ++i) {
    views.push_back(all[camera * kViews + i]);
    SetStamp(StampOf(i) + ros::Duration(0.03 * static_cast<double>(camera)), &views[i]);
  }
  return views;
}

using Messages = std::vector<acmp_mapping::KeyframePointsConstPtr>;

long CountOf(const Messages& messages, const std::string& mapper) {
  return std::count_if(messages.begin(), messages.end(), [&](const auto& m) { return m->mapper == mapper; });
}

/// The map of the messages of these mappers, each mapper's in the order in which they were sent.
PointCloud MapOf(const Messages& messages, const std::set<std::string>& mappers) {
  MapStore store({1000, kVoxelSize});
  for (const auto& message : messages) {
    if (mappers.count(message->mapper) == 0) continue;
    const KeyframePointsHead head = ReadHead(*message);
    const PointCloud points = ToPointCloud(message->points);
    EXPECT_TRUE(message->replaces ? store.Replace(head.key, head.pose, points)
                                  : store.Add(head.key, head.pose, points));
  }
  while (store.LookAroundNext()) continue;
  return store.WorldCloud().points;
}

/// One run, shared by all cases.
struct Session {
  MapperControl left{Parameters{}, Parameters{{"voxel_size", kVoxelSize},
                                              {"map_publish_rate", 0.0},
                                              {"save_folder", std::filesystem::temp_directory_path().string()}}};
  LoadedNodelets others;
  const std::vector<ViewMessages> left_views = ViewsOf(0), right_views = ViewsOf(1);
  ScenePlayer right{ros::NodeHandle("/right")};
  Recorder<geometry_msgs::PoseStamped> right_pose{left.nh, "/right/keyframe_pose"};
  Recorder<acmp_mapping::KeyframePoints> points{left.nh, "keyframe_points"};
  Recorder<sensor_msgs::PointCloud2> map{left.nh, "map_points"};
  Recorder<nav_msgs::Path> path{left.nh, "keyframe_path"};
  std::string failure = Run();

  std::string Run() {
    others.LoadMapper(kRight, {}, {{"/right/keyframe_points", "/keyframe_points"}});
    if (!left.WaitUntilReady() || !right.WaitForMapper() || !right_pose.WaitForPublisher() ||
        !points.WaitForPublisher() || !map.WaitForPublisher() || !path.WaitForPublisher()) {
      return "not all are there";
    }
    // The map and this program listen to both mappers.
    if (!left.WaitForValue("dense_mapper: mapping", "maps that get its points", "2") ||
        !left.WaitForValue("right/dense_mapper: mapping", "maps that get its points", "2")) {
      return "the map server does not hear both mappers";
    }
    for (size_t i = 0; i < kViews; ++i) {
      left.player.Publish(left_views[i]);
      right.Publish(right_views[i]);
    }
    // A view is in its mapper when its pose is there.
    if (!left.keyframe_pose.WaitForCount(kViews) || !right_pose.WaitForCount(kViews)) {
      return "fast maps are missing";
    }
    for (const char* mapper : {kLeft, kRight}) {
      std_srvs::Trigger flush;
      if (!CallService(Concat(mapper, "/flush"), &flush) || !flush.response.success) return flush.response.message;
      const auto all_sent = [&](const Messages& m) {
        return flush.response.message.find(Concat("points were sent ", CountOf(m, mapper), " times")) !=
               std::string::npos;
      };
      if (!points.WaitUntil(all_sent)) return Concat("messages of ", mapper, " are missing");
    }
    return left.CallMap("publish_map") && map.WaitForCount(1) ? "" : "no map";
  }
};

class TwoMappersTest : public SessionTest<Session> {
 protected:
  void SetUp() override { ASSERT_EQ(session().failure, ""); }
};

TEST_F(TwoMappersTest, A_TheMapIsTheUnionOfTheirOwnMaps) {
  const Messages messages = session().points.messages();
  const PointCloud map = ToPointCloud(*session().map.messages().back());
  const PointCloud expected = MapOf(messages, {kLeft, kRight});
  ASSERT_EQ(map.size(), expected.size());
  for (size_t i = 0; i < map.size(); ++i) {
    ASSERT_EQ(map[i].position.x, expected[i].position.x) << "point " << i;
    ASSERT_EQ(map[i].position.z, expected[i].position.z) << "point " << i;
  }
  const size_t of_left = MapOf(messages, {kLeft}).size(), of_right = MapOf(messages, {kRight}).size();
  EXPECT_GT(of_left, 100u);
  EXPECT_GT(of_right, 100u);
  EXPECT_GT(map.size(), std::max(of_left, of_right)) << "something of each";
  EXPECT_LT(map.size(), of_left + of_right) << "the cameras see the same room";
}

TEST_F(TwoMappersTest, B_EveryKeyframeIsInThePathAndInTheFile) {
  EXPECT_TRUE(session().path.WaitForNewest([](const auto& path) { return path.poses.size() == 2 * kViews; }));
  const auto saved = session().left.SaveMap("acmp_two_mappers_rostest.ply", acmp_mapping::SaveMap::Request::PLY, true);
  std::filesystem::remove(std::filesystem::temp_directory_path() / "acmp_two_mappers_rostest.ply");
  EXPECT_EQ(saved.keyframes, 2 * kViews);
  EXPECT_EQ(saved.points, session().map.messages().back()->width);
}

TEST_F(TwoMappersTest, C_OnePathMovesTheKeyframesOfBoth) {
  // It has poses of the left camera alone; the right one goes with it.
  nav_msgs::Path optimized;
  optimized.header.frame_id = kWorldFrame;
  for (const ViewMessages& view : session().left_views) {
    optimized.poses.push_back(view.pose);
    optimized.poses.back().pose.position.x += 3;
  }
  ros::Publisher publisher = session().left.nh.advertise<nav_msgs::Path>("optimized_path", 1);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  const auto before = session().path.messages().back();
  publisher.publish(optimized);
  const auto all_moved = [&](const nav_msgs::Path& path) {
    for (size_t i = 0; i < before->poses.size(); ++i) {
      const double step = path.poses[i].pose.position.x - before->poses[i].pose.position.x;
      if (std::abs(step - 3) > 1e-6) return false;
    }
    return true;
  };
  EXPECT_TRUE(session().path.WaitForNewest(all_moved));
}

// The last one, since it leaves incidents in the diagnostics and an empty map.
TEST_F(TwoMappersTest, D_TheMapServerRefusesWhatCannotBeAndSaysSo) {
  ros::Publisher publisher = session().left.nh.advertise<acmp_mapping::KeyframePoints>("keyframe_points", 10);
  ASSERT_TRUE(WaitForSubscriber(publisher, 2));
  const acmp_mapping::KeyframePoints first = *session().points.messages().front();
  acmp_mapping::KeyframePoints no_pose = first, other_world = first;
  no_pose.id = 1000;
  no_pose.T_world_capture.fill(0);
  other_world.mapper = "/third/dense_mapper";
  other_world.header.frame_id = "elsewhere";
  acmp_mapping::KeyframePoints after_a_gap = other_world;
  after_a_gap.id = 1001;
  after_a_gap.count += 3;
  for (const auto& message : {first, no_pose, other_world, after_a_gap}) publisher.publish(message);
  for (const char* reason : {"keyframe_twice", "bad_keyframe", "other_world_frame", "keyframes_lost"}) {
    EXPECT_TRUE(session().left.WaitForDiagnostic({Concat("incident: ", reason)})) << reason;
  }
  EXPECT_TRUE(session().left.WaitForValue("map_server: map", "keyframes", std::to_string(2 * kViews + 2)));
  EXPECT_TRUE(session().left.CallMap("reset"));
  EXPECT_TRUE(session().left.WaitForValue("map_server: map", "keyframes", "0"));
}

}  // namespace acmp::test::two_mappers_rostest
