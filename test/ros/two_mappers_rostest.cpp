// Two mappers with a camera each send their points to one map: it must be the union of the two maps that the mappers
// would have alone.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <tuple>

#include <acmp_mapping/KeyframePoints.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::two_mappers_rostest {

constexpr size_t kViews = 6;         ///< of each camera
constexpr double kVoxelSize = 0.05;  // as in the .test file

bool Call(const std::string& service) {
  std_srvs::Trigger trigger;
  return ros::service::call(service, trigger) && trigger.response.success;
}

/// A camera and its mapper, seen from outside.
struct Camera {
  Camera(const std::string& camera_ns, std::vector<ViewMessages> camera_views)
      : ns(camera_ns),
        views(std::move(camera_views)),
        player(ros::NodeHandle(ns)),
        pose(ros::NodeHandle(), ns + "/keyframe_pose") {}

  std::string name() const { return ns + "/dense_mapper"; }
  bool WaitUntilReady() const {
    return player.WaitForMapper(kTimeoutS) && pose.WaitForPublisher(kTimeoutS) &&
           ros::service::waitForService(name() + "/flush", ros::Duration(kTimeoutS));
  }

  const std::string ns;
  const std::vector<ViewMessages> views;
  ScenePlayer player;
  Recorder<geometry_msgs::PoseStamped> pose;
};

/// Two cameras that look at the same room from different places, with stamps of their own.
std::vector<ViewMessages> ViewsOf(size_t camera) {
  const std::vector<ViewMessages> all = MakeSmallScene(2 * kViews, 1000, 96);
  std::vector<ViewMessages> views(all.begin() + static_cast<std::ptrdiff_t>(camera * kViews),
                                  all.begin() + static_cast<std::ptrdiff_t>((camera + 1) * kViews));
  for (size_t i = 0; i < kViews; ++i) {
    SetStamp(StampOf(i) + ros::Duration(0.03 * static_cast<double>(camera)), &views[i]);
  }
  return views;
}

using Messages = std::vector<acmp_mapping::KeyframePointsConstPtr>;

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

using Voxel = std::tuple<long, long, long>;

std::map<Voxel, SurfacePoint> ByVoxel(const PointCloud& map) {
  const auto cell = [](float x) { return static_cast<long>(std::floor(x / kVoxelSize)); };
  std::map<Voxel, SurfacePoint> voxels;
  for (const SurfacePoint& p : map) voxels[{cell(p.position.x), cell(p.position.y), cell(p.position.z)}] = p;
  return voxels;
}

bool SamePosition(const SurfacePoint& a, const SurfacePoint& b) {
  return a.position.x == b.position.x && a.position.y == b.position.y && a.position.z == b.position.z;
}

/// One run, shared by all cases.
struct Session {
  ros::NodeHandle nh;
  ros::AsyncSpinner spinner{1};
  Camera left{"/left", ViewsOf(0)}, right{"/right", ViewsOf(1)};
  Recorder<acmp_mapping::KeyframePoints> points{nh, "/keyframe_points"};
  Recorder<sensor_msgs::PointCloud2> map{nh, "/map_points"};
  Recorder<nav_msgs::Path> path{nh, "/keyframe_path"};
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics{nh, "/diagnostics"};
  std::string failure;

  Session() {
    spinner.start();
    failure = Run();
  }

  bool WaitForDiagnostic(const std::string& status, const std::string& key, const std::string& start) {
    return WaitForValue(&diagnostics, status, key, start);
  }

  std::string Run() {
    if (!left.WaitUntilReady() || !right.WaitUntilReady()) return "not all mappers are there";
    if (!points.WaitForPublisher(kTimeoutS, 2) || !map.WaitForPublisher(kTimeoutS) || !path.WaitForPublisher(kTimeoutS))
      return "not all topics are there";
    // The map and this program listen to both mappers.
    if (!WaitForDiagnostic("left/dense_mapper: mapping", "maps that get its points", "2") ||
        !WaitForDiagnostic("right/dense_mapper: mapping", "maps that get its points", "2") ||
        !WaitForDiagnostic("map_server: mappers", "publishers of /keyframe_points", "2")) {
      return "the map server does not hear both mappers";
    }
    for (size_t i = 0; i < kViews; ++i) {
      left.player.Publish(left.views[i]);
      right.player.Publish(right.views[i]);
    }
    // A view is in its mapper when its fast map is there.
    if (!left.pose.WaitForCount(kViews, kTimeoutS) || !right.pose.WaitForCount(kViews, kTimeoutS))
      return "fast maps are missing";
    if (!Call("/left/dense_mapper/flush") || !Call("/right/dense_mapper/flush")) return "flush failed";
    // The right mapper's messages may be under way to the map: how many it has sent, its diagnostics say from now on.
    for (const Camera* camera : {&left, &right}) {
      const auto messages_of = [camera](const Messages& messages) {
        return std::count_if(messages.begin(), messages.end(),
                             [&](const auto& m) { return m->mapper == camera->name(); });
      };
      diagnostics.Clear();
      const std::string task = camera->name().substr(1) + ": mapping";
      if (!diagnostics.WaitUntil([&](const auto& arrays) { return SentBy(arrays, task) > 0; }, kTimeoutS))
        return "no diagnostics of " + camera->name();
      const long sent = SentBy(diagnostics.messages(), task);
      if (!points.WaitUntil([&](const auto& messages) { return messages_of(messages) >= sent; }, kTimeoutS) ||
          !WaitForDiagnostic("map_server: mappers", camera->name(), std::to_string(sent) + " messages")) {
        return "messages of " + camera->name() + " are missing";
      }
    }
    if (!Call("/map_server/publish_map") || !map.WaitForCount(1, kTimeoutS)) return "no map";
    return "";
  }

  static long SentBy(const std::vector<diagnostic_msgs::DiagnosticArrayConstPtr>& arrays, const std::string& task) {
    long sent = 0;
    for (const auto& array : arrays) {
      for (const auto& status : array->status) {
        if (status.name != task) continue;
        for (const auto& value : status.values) {
          if (value.key == "messages sent to them") sent = std::stol(value.value);
        }
      }
    }
    return sent;
  }
};

class TwoMappersTest : public SessionTest<Session> {
 protected:
  void SetUp() override { ASSERT_EQ(session().failure, ""); }
};

TEST_F(TwoMappersTest, A_TheMapIsTheUnionOfTheirOwnMaps) {
  const Messages messages = session().points.messages();
  const std::string left = session().left.name(), right = session().right.name();
  const PointCloud map = ToPointCloud(*session().map.messages().back());
  const PointCloud expected = MapOf(messages, {left, right});
  ASSERT_EQ(map.size(), expected.size());
  for (size_t i = 0; i < map.size(); ++i) ASSERT_TRUE(SamePosition(map[i], expected[i])) << "point " << i;

  const auto of_left = ByVoxel(MapOf(messages, {left})), of_right = ByVoxel(MapOf(messages, {right}));
  ASSERT_GT(of_left.size(), 100u);
  ASSERT_GT(of_right.size(), 100u);
  size_t shared = 0, alone = 0;
  // Within a voxel what the other camera has seen moves points: it changes their confidences.
  for (const auto& [voxel, point] : ByVoxel(map)) {
    const bool is_left = of_left.count(voxel) > 0, is_right = of_right.count(voxel) > 0;
    ASSERT_TRUE(is_left || is_right) << "in neither map";
    shared += is_left && is_right;
    alone += is_left != is_right;
  }
  EXPECT_EQ(2 * shared + alone, of_left.size() + of_right.size()) << "nothing of either is missing";
  EXPECT_GT(shared, 0u) << "the cameras see the same room";
}

TEST_F(TwoMappersTest, B_EveryKeyframeIsInThePathAndInTheFile) {
  EXPECT_TRUE(session().path.WaitUntil(
      [](const auto& paths) { return !paths.empty() && paths.back()->poses.size() == 2 * kViews; }, kTimeoutS));
  acmp_mapping::SaveMap save;
  save.request.path = (std::filesystem::temp_directory_path() / "acmp_two_mappers_rostest.ply").string();
  save.request.binary = true;
  ASSERT_TRUE(ros::service::call("/map_server/save_map", save));
  std::filesystem::remove(save.request.path);
  EXPECT_EQ(save.response.keyframes, 2 * kViews);
  EXPECT_EQ(save.response.points, session().map.messages().back()->width);
}

TEST_F(TwoMappersTest, C_OnePathMovesTheKeyframesOfBoth) {
  // It has poses of the left camera alone; the right one goes with it.
  const RigidTransform correction = RigidTransform(Eigen::Translation3d(1, 2, 3));
  nav_msgs::Path optimized;
  optimized.header.frame_id = kWorldFrame;
  for (const ViewMessages& view : session().left.views) {
    optimized.poses.push_back(view.pose);
    optimized.poses.back().pose.position.x += 1;
    optimized.poses.back().pose.position.y += 2;
    optimized.poses.back().pose.position.z += 3;
  }
  const PointCloud before = ToPointCloud(*session().map.messages().back());
  ros::Publisher publisher = session().nh.advertise<nav_msgs::Path>("/optimized_path", 1);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  publisher.publish(optimized);
  ASSERT_TRUE(session().WaitForDiagnostic("map_server: map", "keyframes re-posed, all corrections together",
                                          std::to_string(2 * kViews)));
  const auto sent = [](const Camera& camera, const geometry_msgs::PoseStamped& pose) {
    return std::find_if(camera.views.begin(), camera.views.end(), [&](const ViewMessages& view) {
             return view.pose.header.stamp == pose.header.stamp;
           }) != camera.views.end();
  };
  const auto path = session().path.messages().back();
  size_t of_left = 0, of_right = 0;
  for (const auto& pose : path->poses) {
    of_left += sent(session().left, pose);
    of_right += sent(session().right, pose);
  }
  EXPECT_EQ(of_left, kViews);
  EXPECT_EQ(of_right, kViews);
  ASSERT_TRUE(Call("/map_server/publish_map"));
  ASSERT_TRUE(session().map.WaitForCount(2, kTimeoutS));
  const auto mean = [](const PointCloud& map) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const SurfacePoint& p : map) sum += Eigen::Vector3d(p.position.x, p.position.y, p.position.z);
    return Eigen::Vector3d(sum / static_cast<double>(map.size()));
  };
  // Other voxels hold other points: the means agree to a part of a voxel.
  const PointCloud after = ToPointCloud(*session().map.messages().back());
  EXPECT_LT((mean(after) - mean(before) - correction.translation()).norm(), kVoxelSize);
}

// The last one, since it leaves incidents in the diagnostics and an empty map.
TEST_F(TwoMappersTest, D_TheMapServerRefusesWhatCannotBeAndSaysSo) {
  ros::Publisher publisher = session().nh.advertise<acmp_mapping::KeyframePoints>("/keyframe_points", 10);
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
  while (publisher.getNumSubscribers() < 2 && ros::WallTime::now() < end) ros::WallDuration(0.05).sleep();
  const Messages messages = session().points.messages();
  acmp_mapping::KeyframePoints twice = *messages.front();
  ASSERT_FALSE(twice.replaces);
  publisher.publish(twice);
  acmp_mapping::KeyframePoints no_pose = *messages.front();
  no_pose.id = 1000;
  no_pose.T_world_cam.fill(0);
  publisher.publish(no_pose);
  acmp_mapping::KeyframePoints other_world = *messages.front();
  other_world.mapper = "/third/dense_mapper";
  other_world.header.frame_id = "elsewhere";
  publisher.publish(other_world);
  acmp_mapping::KeyframePoints after_a_gap = other_world;
  after_a_gap.id = 1001;
  after_a_gap.count += 3;
  publisher.publish(after_a_gap);
  const auto says = [&](const std::string& reason) {
    return session().WaitForDiagnostic("map_server: map", "incident: " + reason, "");
  };
  EXPECT_TRUE(says("keyframe_twice"));
  EXPECT_TRUE(says("bad_keyframe"));
  EXPECT_TRUE(says("other_world_frame"));
  EXPECT_TRUE(says("keyframes_lost"));
  EXPECT_TRUE(session().WaitForDiagnostic("map_server: map", "keyframes", std::to_string(2 * kViews + 2)));
  EXPECT_TRUE(Call("/map_server/reset"));
  session().diagnostics.Clear();
  EXPECT_TRUE(session().WaitForDiagnostic("map_server: map", "keyframes", "0"));
}

}  // namespace acmp::test::two_mappers_rostest
