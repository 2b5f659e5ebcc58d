// save_session and load_session of a running map.

#include <filesystem>
#include <fstream>
#include <iterator>

#include <acmp_mapping/LoadSession.h>
#include <acmp_mapping/SaveSession.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "ros/mapper_control.h"
#include "support/error_text.h"

namespace acmp::test::sessions_rostest {

namespace fs = std::filesystem;
using acmp_mapping::LoadSession;
using acmp_mapping::SaveMap;
using acmp_mapping::SaveSession;

constexpr size_t kViews = 5;

class SessionsTest : public SavingTest {
 protected:
  static std::vector<ViewMessages> Scene() { return MakeSmallScene(kViews, 1000); }
  SaveSession::Response Save(const std::string& name) const {
    SaveSession save;
    save.request.path = PathOf(name);
    EXPECT_TRUE(CallService("/map_server/save_session", &save));
    return save.response;
  }
  LoadSession::Response Load(const std::string& name, const geometry_msgs::Transform& transform = {},
                             bool find_transform = false) const {
    LoadSession load;
    load.request.find_transform = find_transform;
    load.request.path = PathOf(name);
    load.request.T_world_session = transform;
    EXPECT_TRUE(CallService("/map_server/load_session", &load));
    return load.response;
  }
  static std::string BytesOf(const std::string& path) {
    std::ifstream stream(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  }
  /// The map as a file has it; empty when it is not saved.
  std::string MapBytes(const std::string& server = "map_server") const {
    acmp_mapping::SaveMap save;
    save.request.path = PathOf("map.ply");
    save.request.binary = true;
    if (!CallService("/" + server + "/save_map", &save) || !save.response.success) return "";
    return BytesOf(PathOf("map.ply"));
  }
};

TEST_F(SessionsTest, AMapIsSavedAndLoadedAgainAndGoesOn) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  const std::string before = MapBytes();
  ASSERT_GT(before.size(), 1000u);
  const SaveSession::Response saved = Save("session.bag");
  ASSERT_TRUE(saved.success) << saved.message;
  EXPECT_EQ(saved.keyframes, kViews);
  EXPECT_GT(saved.points, 100u);
  ASSERT_TRUE(mapper().CallMap("reset"));
  EXPECT_EQ(MapBytes(), "");
  const LoadSession::Response loaded = Load("session.bag");
  ASSERT_TRUE(loaded.success) << loaded.message;
  EXPECT_EQ(loaded.keyframes, kViews);
  EXPECT_EQ(loaded.points, saved.points);
  EXPECT_EQ(MapBytes(), before);

  // And it goes on: the same images in another run.
  ASSERT_TRUE(mapper().Call("reset"));
  EXPECT_EQ(mapper().Map(Scene()), kViews);
  EXPECT_EQ(mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true).keyframes, 2 * kViews);
}

TEST_F(SessionsTest, ImagesAreKeptForAColmapModel) {
  const SaveMap::Response empty = mapper().SaveMap(PathOf("map.colmap"), SaveMap::Request::COLMAP, true);
  EXPECT_THAT(empty.message, HasSubstr("the map is empty"));
  EXPECT_FALSE(fs::exists(PathOf("map.colmap")));
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  const SaveMap::Response saved = mapper().SaveMap(PathOf("map.colmap"), SaveMap::Request::COLMAP, true);
  ASSERT_TRUE(saved.success) << saved.message;
  EXPECT_EQ(saved.keyframes, kViews);
  const auto model = ReadScene(PathOf("map.colmap"), SceneFormat::kColmap);
  EXPECT_EQ(model.landmarks_in_world.size(), saved.points);
  EXPECT_EQ(model.images[1].name, "0000001000_100000000_dense_mapper.jpg");
  ASSERT_EQ(model.images.size(), kViews);
  for (const SceneImage& image : model.images) {
    EXPECT_EQ(ReadColorImage(image.path, ImageSize{48, 36}).width(), 48) << "as keep_images says; the maps have 64";
    EXPECT_EQ(image.camera.width, 48);
    EXPECT_GT(image.landmark_indices.size(), 100u);
  }
  EXPECT_TRUE(mapper().WaitForDiagnostic({Concat(kViews, ", 0 MB")})) << "images kept";

  // Also of a session.
  ASSERT_TRUE(Save("session.bag").success);
  ASSERT_TRUE(mapper().CallMap("reset"));
  ASSERT_TRUE(Load("session.bag").success);
  ASSERT_TRUE(mapper().SaveMap(PathOf("again.colmap"), SaveMap::Request::COLMAP, true).success);
  for (const std::string name : {"sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin",
                                 "images/0000001000_100000000_dense_mapper.jpg"}) {
    EXPECT_TRUE(BytesOf(PathOf("again.colmap/" + name)) == BytesOf(PathOf("map.colmap/" + name))) << name;
  }
  EXPECT_THAT(mapper().SaveMap(PathOf("map.colmap"), SaveMap::Request::COLMAP, true).message,
              HasSubstr("map.colmap, in place of the folder of that name"));
}

TEST_F(SessionsTest, AKeyframeWhoseImageCannotBeKeptIsInTheMapWithoutIt) {
  ros::Publisher publisher = mapper().nh.advertise<acmp_mapping::KeyframePoints>("keyframe_points", 10);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  KeyframePointsHead head;
  head.key = {"/other", 1, 1};
  head.pose.camera = {64, 48, 50, 50, 31.5, 23.5};
  head.world_frame = kWorldFrame;
  acmp_mapping::KeyframePointsPtr message = ToKeyframePoints(head, {{{0, 0, 1}, {0, 0, -1}, {}, 0, 1}});
  message->count = 1;
  FillImage("no image", message.get());
  publisher.publish(message);
  EXPECT_TRUE(mapper().WaitForDiagnostic(
      {"keyframe 1 of \"/other\" is in the map without its image: image of 8 bytes is no JPEG file"}));
  EXPECT_EQ(mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true).keyframes, 1u);
  EXPECT_THAT(mapper().SaveMap(PathOf("map.colmap"), SaveMap::Request::COLMAP, true).message,
              HasAll("1 keyframes and no image of them", "~keep_images"));
}

TEST_F(SessionsTest, FilesOfOthersAreNotReplaced) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  for (const auto& [name, format] : {std::pair{"scan.ply", SaveMap::Request::PLY},
                                     {"scan.obj", SaveMap::Request::MESH_OBJ},
                                     {"scan.bt", SaveMap::Request::OCTOMAP},
                                     {"scan.bag", SaveMap::Request::PLY}}) {
    std::ofstream(PathOf(name)) << "precious";
    const bool is_session = fs::path(name).extension() == ".bag";
    EXPECT_THAT(is_session ? Save(name).message : mapper().SaveMap(PathOf(name), format, true).message,
                HasAll(name, "was not written by this program"));
    EXPECT_EQ(BytesOf(PathOf(name)), "precious");
  }
}

TEST_F(SessionsTest, ASecondOneIsAddedByATransform) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  EXPECT_THAT(Save("session.ply").message, HasSubstr("must end in .bag"));
  EXPECT_THAT(Save("session.bag").message, Not(HasSubstr("in place of")));
  EXPECT_THAT(Save("session.bag").message, HasSubstr("session.bag, in place of the file of that name"));
  ASSERT_TRUE(mapper().CallMap("reset") && mapper().Call("reset"));
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  Recorder<nav_msgs::Path> paths(mapper().nh, "keyframe_path");
  geometry_msgs::Transform transform;
  transform.translation.y = 20;
  transform.rotation.z = 1;
  const LoadSession::Response loaded = Load("session.bag", transform);
  ASSERT_TRUE(loaded.success) << loaded.message;
  ASSERT_TRUE(paths.WaitForNewest([](const auto& path) { return path.poses.size() == 2 * kViews; }));
  const auto& poses = paths.messages().back()->poses;  // the earlier run first
  for (size_t i = 0; i < kViews; ++i) {
    EXPECT_NEAR(poses[i].pose.position.x, -poses[kViews + i].pose.position.x, 1e-9);
    EXPECT_NEAR(poses[i].pose.position.y, 20 - poses[kViews + i].pose.position.y, 1e-9);
    EXPECT_NEAR(poses[i].pose.position.z, poses[kViews + i].pose.position.z, 1e-9);
  }
  EXPECT_THAT(Load("session.bag", transform, true).message, HasSubstr("T_world_session and find_transform"));
  transform.rotation.x = 1;
  EXPECT_THAT(Load("session.bag", transform).message, HasSubstr("T_world_session"));
}

TEST_F(SessionsTest, WhatCannotBeUsedIsRefusedAndTheMapStays) {
  const SaveSession::Response empty = Save("session.bag");
  EXPECT_FALSE(empty.success);
  EXPECT_THAT(empty.message, HasSubstr("the map is empty"));
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  ASSERT_TRUE(Save("session.bag").success);
  const std::string before = MapBytes();
  const LoadSession::Response again = Load("session.bag");
  EXPECT_FALSE(again.success);
  EXPECT_THAT(again.message, HasAll(PathOf("session.bag"), " of \"/dense_mapper\", run ", "is in the map already",
                                    "nothing was loaded"));
  // Images of 64 x 48 px show too little.
  EXPECT_THAT(Load("session.bag", {}, true).message,
              HasAll("where it lies in the map is not sure", "nothing was loaded"));
  EXPECT_THAT(Load("none.bag").message, HasAll("none.bag", "no such file"));
  EXPECT_THAT(Load("../../none.bag").message, HasSubstr("must lie below"));
  EXPECT_THAT(Save("../../none.bag").message, HasSubstr("must lie below"));
  EXPECT_EQ(MapBytes(), before);
}

/// A second map server, in the same manager.
bool LoadSecondServer(const std::string& session) {
  ros::param::set("/second/save_folder", fs::temp_directory_path().string());
  ros::param::set("/second/load_session", session);
  return LoadNodelet("/second", "MapServerNodelet");
}

TEST_F(SessionsTest, AMapBeginsWithTheSessionOfItsParameter) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  ASSERT_TRUE(Save("session.bag").success);
  const std::string before = MapBytes();
  EXPECT_FALSE(LoadSecondServer(PathOf("none.bag")));
  EXPECT_TRUE(mapper().WaitForLog({"cannot start", "none.bag", "no such file"}));
  ASSERT_TRUE(LoadSecondServer(PathOf("session.bag")));
  EXPECT_EQ(MapBytes("second"), before);
  EXPECT_TRUE(UnloadNodelet("/second"));
}

}  // namespace acmp::test::sessions_rostest
