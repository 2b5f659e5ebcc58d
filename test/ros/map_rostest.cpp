// A loop closure: the scene is mapped with poses that drift, then optimized_path brings the true ones.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <thread>

#include <acmp_mapping/DistanceChange.h>
#include <acmp_mapping/GetDistances.h>
#include <gtest/gtest.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Path.h>
#include <tf2_eigen/tf2_eigen.h>
#include <visualization_msgs/MarkerArray.h>

#include "acmp_mapping/map/distance_field.h"
#include "acmp_mapping/map/map_mesh.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/ros/occupancy_output.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::map_rostest {

constexpr size_t kViews = 6;
constexpr double kVoxelSize = 0.05;

/// Another world that slides on by a millimetre per view: little enough for neighbours to be matched.
RigidTransform DriftAt(size_t view) {
  RigidTransform drift = RigidTransform::Identity();
  drift.translation() = Eigen::Vector3d(5, -3, 1) + Eigen::Vector3d(1e-3, 0, 0) * static_cast<double>(view);
  drift.rotate(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()));
  return drift;
}

bool Near(const Vec3f& a, const Vec3f& b) {
  // float32 of coordinates below 16; poses went through quaternions in double
  constexpr float kTolerance = 2e-6f;
  return std::abs(a.x - b.x) <= kTolerance && std::abs(a.y - b.y) <= kTolerance && std::abs(a.z - b.z) <= kTolerance;
}

bool Same(const PointCloud& a, const PointCloud& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](const auto& p, const auto& q) {
           return Near(p.position, q.position) && Near(p.normal, q.normal);
         });
}

bool SamePoses(const nav_msgs::Path& path, const std::vector<RigidTransform>& poses) {
  if (path.poses.size() != poses.size()) return false;
  for (size_t i = 0; i < poses.size(); ++i) {
    const geometry_msgs::Point& position = path.poses[i].pose.position;
    const Eigen::Quaterniond expected(poses[i].linear());
    const geometry_msgs::Quaternion& q = path.poses[i].pose.orientation;
    // 1e-9: inverted, multiplied and turned into quaternions and back in double
    if ((Eigen::Vector3d(position.x, position.y, position.z) - poses[i].translation()).norm() > 1e-9) return false;
    if (std::abs(Eigen::Quaterniond(q.w, q.x, q.y, q.z).dot(expected)) < 1 - 1e-9) return false;
  }
  return true;
}

/// Triangles of each marker that a listener of the mesh has.
std::map<int, size_t> MarkersOf(const std::vector<visualization_msgs::MarkerArray::ConstPtr>& messages) {
  std::map<int, size_t> markers;
  for (const auto& message : messages) {
    for (const visualization_msgs::Marker& marker : message->markers) {
      if (marker.action == visualization_msgs::Marker::DELETEALL) markers.clear();
      if (marker.action == visualization_msgs::Marker::DELETE) markers.erase(marker.id);
      if (marker.action != visualization_msgs::Marker::ADD) continue;
      EXPECT_EQ(marker.header.frame_id, kWorldFrame);
      EXPECT_EQ(marker.type, visualization_msgs::Marker::TRIANGLE_LIST);
      EXPECT_EQ(marker.colors.size(), marker.points.size());
      markers[marker.id] = marker.points.size() / 3;
    }
  }
  return markers;
}

size_t TrianglesOf(const std::vector<visualization_msgs::MarkerArray::ConstPtr>& messages) {
  size_t triangles = 0;
  for (const auto& [id, count] : MarkersOf(messages)) triangles += count;
  return triangles;
}

/// One run of the mapper up to the loop closure, for all cases.
struct Session {
  // The map is compared with the points that were published: no keyframe is refined again. All of the scene is between
  // the heights.
  MapperControl mapper{{{"refine_again", false}},
                       Parameters{{"voxel_size", kVoxelSize},
                                  {"map_publish_rate", 30.0},
                                  {"occupancy_min_height", -2.0},
                                  {"occupancy_max_height", 5.0}}};
  LoadedNodelets high;  ///< a second map of the same keyframes
  std::vector<RigidTransform> true_poses, drifted_poses;
  Recorder<sensor_msgs::PointCloud2> points{mapper.nh, "points"};
  Recorder<sensor_msgs::PointCloud2> map{mapper.nh, "map_points"};
  Recorder<nav_msgs::Path> path{mapper.nh, "keyframe_path"};
  std::unique_ptr<Recorder<visualization_msgs::MarkerArray>> mesh =
      std::make_unique<Recorder<visualization_msgs::MarkerArray>>(mapper.nh, "mesh");
  ros::Publisher optimized_path = mapper.nh.advertise<nav_msgs::Path>("optimized_path", 2);
  std::vector<SyntheticView> views;  ///< with drifted poses
  bool mapped = false;

  Session() {
    for (SyntheticView& view : MakeSyntheticScene({64, 48, kViews})) {
      const RigidTransform drift = DriftAt(views.size());
      true_poses.push_back(view.frame.cam_from_world.inverse());
      drifted_poses.push_back(drift * true_poses.back());
      view.frame.cam_from_world = drifted_poses.back().inverse();
      for (Eigen::Vector3d& landmark : view.frame.landmarks_in_world) landmark = drift * landmark;
      views.push_back(std::move(view));
    }
    if (!WaitForSubscriber(optimized_path) || !mapper.WaitUntilReady() || !mapper.WaitForMapServer()) return;
    high.LoadMapServer("/high/map_server",
                       {{"occupancy_min_height", 100.0}, {"occupancy_max_height", 101.0}, {"mesh_rate", 0.0}},
                       {{"/high/keyframe_points", "/keyframe_points"}});
    mapped = points.WaitForPublisher() && map.WaitForPublisher() && path.WaitForPublisher() &&
             mapper.Map(Messages(1000)) == kViews && points.WaitForCount(kViews);
  }

  std::vector<ViewMessages> Messages(uint32_t start_s) const {
    std::vector<ViewMessages> messages;
    for (const SyntheticView& view : views) messages.push_back(MakeMessages(view, StampOf(messages.size(), start_s)));
    return messages;
  }

  /// The map of the keyframes' points, as they were published, corrected to these poses.
  PointCloud ExpectedMap(const std::vector<RigidTransform>& poses) { return ExpectedStore(poses)->WorldCloud().points; }
  std::unique_ptr<MapStore> ExpectedStore(const std::vector<RigidTransform>& poses) {
    auto store = std::make_unique<MapStore>(MapStoreOptions{1000, kVoxelSize});
    uint64_t id = 0;
    for (const auto& message : points.messages()) {
      store->Add({"mapper", 0, id}, {static_cast<int64_t>(StampOf(id).toNSec()), drifted_poses[id], {}},
                 ToPointCloud(*message));
      ++id;
    }
    while (store->LookAroundNext()) continue;
    std::vector<StampedPose> path;
    for (const RigidTransform& pose : poses) {
      path.push_back({static_cast<int64_t>(StampOf(path.size()).toNSec()), pose});
    }
    store->Repose(path);
    return store;
  }

  bool WaitForMap(const PointCloud& expected) {
    return map.WaitForNewest([&](const auto& message) { return Same(ToPointCloud(message), expected); });
  }

  /// That what was told of the mesh is the saved one. Its voxels of few points are large: 1 % are some triangles whose
  /// distances are averaged in another order.
  bool WaitForMesh(const std::vector<RigidTransform>& poses) {
    const auto expected =
        static_cast<double>(MakeMapMesh(*ExpectedStore(poses), {0, 1000000000}).mesh.triangles.size());
    return expected > 100 && mesh->WaitUntil([&](const auto& messages) {
      return std::abs(static_cast<double>(TrianglesOf(messages)) - expected) <= 0.01 * expected;
    });
  }

  bool WaitForPath(const std::vector<RigidTransform>& poses) {
    return path.WaitForNewest([&](const auto& message) { return SamePoses(message, poses); });
  }

  /// As frontends send it: all poses each time, stamps through a double, an old-style frame.
  nav_msgs::Path MakePath(const std::vector<RigidTransform>& poses) const {
    nav_msgs::Path message;
    message.header.frame_id = "/" + std::string(kWorldFrame);
    for (size_t i = 0; i < poses.size(); ++i) {
      geometry_msgs::PoseStamped pose;
      pose.header.frame_id = message.header.frame_id;
      pose.header.stamp = StampOf(i) + ros::Duration(0, i % 2 == 0 ? 119 : -119);
      pose.pose = tf2::toMsg(poses[i]);
      message.poses.push_back(pose);
    }
    return message;
  }
};

class MapTest : public SessionTest<Session> {
 protected:
  void SetUp() override { ASSERT_TRUE(session().mapped) << "the mapper did not answer in time"; }
};

constexpr char kCorrections[] = "loop corrections (paths that moved keyframes) = ";

// In this order: each case begins where the one before ended.

TEST_F(MapTest, A_TheMapIsWhereThePosesAre) {
  const PointCloud expected = session().ExpectedMap(session().drifted_poses);
  ASSERT_GT(expected.size(), 100u);
  EXPECT_TRUE(session().WaitForMap(expected));
  EXPECT_TRUE(session().WaitForMesh(session().drifted_poses));
  EXPECT_TRUE(session().WaitForPath(session().drifted_poses));
}

TEST_F(MapTest, B_AnOptimizedPathMovesMapAndPath) {
  session().optimized_path.publish(session().MakePath(session().true_poses));
  EXPECT_TRUE(session().WaitForPath(session().true_poses));
  EXPECT_TRUE(session().WaitForMap(session().ExpectedMap(session().true_poses))) << "published again by itself";
  EXPECT_EQ(session().map.messages().back()->header.frame_id, kWorldFrame);
  EXPECT_TRUE(session().WaitForMesh(session().true_poses));
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({kCorrections + std::string("1")}));
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"keyframes re-posed", "= " + std::to_string(kViews)}));
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"without a keyframe", "= 0 of 6"}));
}

TEST_F(MapTest, C_TheSamePathAgainMovesNothingAndWhatCannotBeUsedIsCounted) {
  session().path.Clear();
  nav_msgs::Path path = session().MakePath(session().true_poses);
  path.poses[1].pose.position.x = std::numeric_limits<double>::quiet_NaN();
  path.poses[2].pose.orientation.w += 0.1;
  path.poses[3].header.frame_id = "somewhere";
  session().optimized_path.publish(path);
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"incident: bad_optimized_pose", "= 2", "norm"}));
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"incident: optimized_path_frame", "\"somewhere\""}));
  EXPECT_TRUE(session().mapper.WaitForLog({"bad_optimized_pose", "not finite"}));
  ASSERT_TRUE(session().mapper.CallMap("publish_map")) << "after all that has come";
  EXPECT_EQ(session().mapper.DiagnosticValue("map_server: map", "loop corrections (paths that moved keyframes)"), "1");
  EXPECT_TRUE(session().path.messages().empty());
}

TEST_F(MapTest, D_OccupancyIsPublishedToWhoListens) {
  const OccupancySlice expected =
      MakeOccupancyMap(session().ExpectedStore(session().true_poses)->Placed(), 0)->Slice(-2, 5);
  Recorder<nav_msgs::OccupancyGrid> occupancy(session().mapper.nh, "occupancy");
  ASSERT_TRUE(occupancy.WaitForCount(1));
  const auto message = occupancy.messages().back();
  EXPECT_EQ(message->header.frame_id, kWorldFrame);
  EXPECT_NEAR(message->info.resolution, kOccupancyVoxels * kVoxelSize, 1e-6);
  ASSERT_EQ(message->info.width, static_cast<uint32_t>(expected.width));
  ASSERT_EQ(message->info.height, static_cast<uint32_t>(expected.height));
  EXPECT_NEAR(message->info.origin.position.x, expected.origin_x, 1e-6);
  EXPECT_NEAR(message->info.origin.position.y, expected.origin_y, 1e-6);
  int different = 0, occupied = 0;
  for (size_t i = 0; i < expected.cells.size(); ++i) {
    const int cell = expected.cells[i] == Occupancy::kFree ? 0 : expected.cells[i] == Occupancy::kOccupied ? 100 : -1;
    different += message->data.at(i) != cell ? 1 : 0;
    occupied += cell == 100 ? 1 : 0;
  }
  EXPECT_LE(different, 2) << "of " << expected.cells.size() << ": poses went through quaternions";
  EXPECT_GT(occupied, 0);
}

/// Distances, and the example of docs/map.md that checks a path against them.
TEST_F(MapTest, D_DistancesAreToldAndTheExampleChecksAPath) {
  const PlacedKeyframes map = session().ExpectedStore(session().true_poses)->Placed();
  LiveOccupancy occupancy{{}};
  DistanceField field(false, 500000000);
  const LiveOccupancy::Change change = occupancy.Update(map);
  field.Update(occupancy, change, map.keyframes.back().world_from_cam.translation(), 1);
  const DistanceGrid& grid = *field.grid();
  acmp_mapping::GetDistances call;
  std::vector<Eigen::Vector3d> free, blocked;
  ASSERT_EQ(grid.resolution, kOccupancyVoxels * kVoxelSize);
  VoxelIndex voxel;
  for (voxel[0] = grid.box.low[0]; voxel[0] <= grid.box.high[0]; ++voxel[0]) {
    for (voxel[1] = grid.box.low[1]; voxel[1] <= grid.box.high[1]; ++voxel[1]) {
      for (voxel[2] = grid.box.low[2]; voxel[2] <= grid.box.high[2]; ++voxel[2]) {
        const Eigen::Vector3d at(voxel[0] + 0.4, voxel[1] + 0.5, voxel[2] + 0.7);
        const Eigen::Vector3d point = grid.resolution * at;
        call.request.points.push_back(tf2::toMsg(point));
        const PointDistance distance = grid.At(point);
        if (distance.occupancy == Occupancy::kFree && distance.distance > 0.5f) free.push_back(point);
        if (distance.occupancy == Occupancy::kOccupied) blocked.push_back(point);
      }
    }
  }
  call.request.points.resize(std::min<size_t>(call.request.points.size(), 5000));
  ASSERT_FALSE(free.empty());
  ASSERT_FALSE(blocked.empty());
  Recorder<acmp_mapping::DistanceChange> changes(session().mapper.nh, "distance_change");
  Recorder<sensor_msgs::PointCloud2> slice(session().mapper.nh, "distance_slice");
  const std::string service = session().mapper.nh.resolveName("/map_server/get_distances");
  ASSERT_TRUE(ros::service::call(service, call));
  ASSERT_TRUE(call.response.success) << call.response.message;
  ASSERT_EQ(call.response.distance.size(), call.request.points.size());
  EXPECT_EQ(call.response.header.frame_id, kWorldFrame);
  size_t different = 0;
  for (size_t i = 0; i < call.request.points.size(); ++i) {
    const geometry_msgs::Point& p = call.request.points[i];
    const PointDistance expected = grid.At({p.x, p.y, p.z});
    EXPECT_EQ(std::isnan(call.response.distance[i]), std::isnan(expected.distance));
    different += std::abs(call.response.distance[i] - expected.distance) > 1e-5f ||
                 call.response.occupancy[i] != static_cast<uint8_t>(expected.occupancy);
  }
  EXPECT_LE(different, call.request.points.size() / 50) << "poses went through quaternions";
  ASSERT_TRUE(changes.WaitForCount(1));
  EXPECT_EQ(changes.messages().front()->version, call.response.version);
  ASSERT_TRUE(slice.WaitForCount(1));
  EXPECT_GT(slice.messages().front()->width, 100u);

  acmp_mapping::GetDistances bad;
  bad.request.points.resize(2);
  bad.request.points[1].y = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(ros::service::call(service, bad));
  EXPECT_FALSE(bad.response.success);
  EXPECT_NE(bad.response.message.find("points[1]"), std::string::npos) << bad.response.message;
  bad.request.points.assign(1000000, {});
  ASSERT_TRUE(ros::service::call(service, bad));
  EXPECT_FALSE(bad.response.success);
  EXPECT_NE(bad.response.message.find("100000"), std::string::npos) << bad.response.message;

  std::ifstream docs(ACMP_SOURCE_DIR "/docs/map.md");
  std::string text((std::istreambuf_iterator<char>(docs)), {});
  text = text.substr(text.find("<!-- run by map_rostest.cpp -->"));
  const std::string begin = "```python\n";
  text = text.substr(text.find(begin) + begin.size());
  text = text.substr(0, text.find("```"));
  for (size_t at = 0; (at = text.find("/acmp/map_server", at)) != std::string::npos;)
    text.replace(at, std::string("/acmp/map_server/get_distances").size(), service);
  const std::filesystem::path script =
      std::filesystem::temp_directory_path() / ("acmp_path_" + std::to_string(getpid()));
  std::ofstream(script) << text;
  const auto check = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    std::string command = "python3 " + script.string();
    for (const Eigen::Vector3d& p : {from, to}) {
      command += " " + std::to_string(p.x()) + "," + std::to_string(p.y()) + "," + std::to_string(p.z());
    }
    return WEXITSTATUS(std::system(command.c_str()));
  };
  EXPECT_EQ(check(free[0], free[0]), 0);
  EXPECT_EQ(check(free[0], blocked[0]), 1);
  std::filesystem::remove(script);
}

/// The floor is not at 0, or the heights are those of another unit.
TEST_F(MapTest, D_OccupancyWithoutCellsNamesTheHeights) {
  Recorder<nav_msgs::OccupancyGrid> occupancy(session().mapper.nh, "/high/occupancy");
  ASSERT_TRUE(occupancy.WaitForCount(1));
  EXPECT_TRUE(occupancy.messages().back()->data.empty());
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"incident: occupancy_empty", "100", "101", kWorldFrame}));
}

TEST_F(MapTest, D_WithoutAMeshThereIsNoSuchTopic) {
  ros::master::V_TopicInfo topics;
  ASSERT_TRUE(ros::master::getTopics(topics));
  const auto is_there = [&](const char* name) {
    return std::any_of(topics.begin(), topics.end(), [&](const auto& topic) { return topic.name == name; });
  };
  EXPECT_TRUE(is_there("/mesh"));
  EXPECT_TRUE(is_there("/high/occupancy"));
  EXPECT_FALSE(is_there("/high/mesh"));
}

TEST_F(MapTest, D_WhoListensLaterGetsTheWholeMesh) {
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"mesh", "triangles of 6 keyframes"}));
  session().mesh.reset();
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"mesh", "nobody listens: nothing is computed"}));
  session().mesh = std::make_unique<Recorder<visualization_msgs::MarkerArray>>(session().mapper.nh, "mesh");
  EXPECT_TRUE(session().WaitForMesh(session().true_poses));
}

/// Planners would go on seeing obstacles that are gone, or be told of distances to them, asked for long ago.
TEST_F(MapTest, E_ResetForgetsCorrectionsAndEmptiesWhatIsLatched) {
  Recorder<acmp_mapping::DistanceChange> changes(session().mapper.nh, "distance_change");
  Recorder<sensor_msgs::PointCloud2> slice(session().mapper.nh, "distance_slice");
  ASSERT_TRUE(changes.WaitForPublisher() && slice.WaitForCount(1));
  std::this_thread::sleep_for(std::chrono::duration<double>(OccupancyOutput::kAskedForS));
  ASSERT_TRUE(session().mapper.Call("reset") && session().mapper.CallMap("reset"));
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"optimized paths = 0 received"}));
  // Who subscribes now may first get what this process last got, which was sent before.
  Recorder<nav_msgs::Path> path(session().mapper.nh, "keyframe_path");
  EXPECT_TRUE(path.WaitForNewest([](const auto& newest) { return newest.poses.empty(); }));
  Recorder<nav_msgs::OccupancyGrid> occupancy(session().mapper.nh, "occupancy");
  EXPECT_TRUE(occupancy.WaitForNewest([](const auto& newest) { return newest.data.empty(); }));
  EXPECT_TRUE(session().mesh->WaitUntil([](const auto& messages) { return MarkersOf(messages).empty(); }));
  EXPECT_TRUE(session().mesh->WaitUntil([](const auto& messages) {
    return std::all_of(messages.end() - 2, messages.end(), [](const auto& message) {
      return message->markers[0].action == visualization_msgs::Marker::DELETEALL;
    });
  })) << "once more, for who has lost it";
  EXPECT_TRUE(slice.WaitForNewest([](const auto& newest) { return newest.width == 0; }));
  EXPECT_TRUE(changes.WaitForNewest([](const auto& newest) { return newest.all; }));
  acmp_mapping::GetDistances call;
  call.request.points.resize(1);
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(ros::service::call(session().mapper.nh.resolveName("/map_server/get_distances"), call));
    EXPECT_FALSE(call.response.success);
  }
}

/// Of a world whose z points forward heights tell nothing, though something of the map lies between them.
TEST_F(MapTest, F_OccupancyIsEmptyWhereZDoesNotPointUp) {
  RigidTransform forward_from_world = RigidTransform::Identity();
  forward_from_world.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  for (SyntheticView& view : session().views) {
    view.frame.cam_from_world = view.frame.cam_from_world * forward_from_world.inverse();
    for (Eigen::Vector3d& landmark : view.frame.landmarks_in_world) landmark = forward_from_world * landmark;
  }
  ASSERT_EQ(session().mapper.Map(session().Messages(2000)), kViews);
  Recorder<nav_msgs::OccupancyGrid> occupancy(session().mapper.nh, "occupancy");
  EXPECT_TRUE(session().mapper.WaitForDiagnostic({"incident: occupancy_not_upright", "z_up"}));
  EXPECT_TRUE(occupancy.WaitForCount(1));
  for (const auto& grid : occupancy.messages()) EXPECT_TRUE(grid->data.empty());
  EXPECT_TRUE(session().map.WaitForNewest([](const auto& newest) { return newest.width * newest.height > 0; }));
}

}  // namespace acmp::test::map_rostest
