// The services and dynamic_reconfigure of a running mapper.

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>

#include <acmp_mapping/DenseMapperConfig.h>
#include <dynamic_reconfigure/Reconfigure.h>
#include <dynamic_reconfigure/config_tools.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/SetBool.h>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "ros/mapper_control.h"
#include "support/error_text.h"

namespace acmp::test::services_rostest {

namespace fs = std::filesystem;
using acmp_mapping::SaveMap;
using dynamic_reconfigure::ConfigTools;

constexpr size_t kViews = 5;

class ServicesTest : public SavingTest {
 protected:
  void SetUp() override {
    start_s_ += 100;
    SavingTest::SetUp();
  }
  static uint32_t StartS() { return start_s_; }
  static std::vector<ViewMessages> Scene() { return MakeSmallScene(kViews, start_s_); }

  /// The configuration after a change, as the server answers it.
  static acmp_mapping::DenseMapperConfig Reconfigure(const std::function<void(dynamic_reconfigure::Config*)>& change) {
    dynamic_reconfigure::Reconfigure call;
    change(&call.request.config);
    EXPECT_TRUE(CallService("/dense_mapper/set_parameters", &call));
    acmp_mapping::DenseMapperConfig config;
    config.__fromMessage__(call.response.config);
    return config;
  }

 private:
  inline static uint32_t start_s_ = 1000;
};

TEST_F(ServicesTest, SaveMapWritesEveryFormatOfWhatIsThere) {
  const auto expect_header = [&](const std::string& name, const std::string& header) {
    std::string line;
    std::getline(std::ifstream(PathOf(name)), line);
    EXPECT_EQ(line.substr(0, header.size()), header) << name;
  };
  const struct {
    uint8_t format;
    const char *name, *header;
  } formats[] = {{SaveMap::Request::PLY, "map.ply", "ply"},
                 {SaveMap::Request::PCD, "map.pcd", "# .PCD"},
                 {SaveMap::Request::MESH_PLY, "mesh.ply", "ply"},
                 {SaveMap::Request::MESH_OBJ, "mesh.obj", ""},
                 {SaveMap::Request::OCTOMAP, "map.bt", "# Octomap OcTree binary file"}};
  for (const auto& [format, name, header] : formats) {
    const SaveMap::Response empty = mapper().SaveMap(PathOf(name), format, true);
    EXPECT_FALSE(empty.success);
    EXPECT_THAT(empty.message, HasSubstr("the map is empty"));
    EXPECT_FALSE(fs::exists(PathOf(name)));
  }
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  std::map<std::string, uint32_t> points;
  for (const auto& [format, name, header] : formats) {
    for (const bool binary : {true, false}) {
      const SaveMap::Response saved = mapper().SaveMap(PathOf(name), format, binary);
      ASSERT_TRUE(saved.success) << saved.message;
      EXPECT_EQ(saved.keyframes, kViews);
      EXPECT_THAT(saved.message, HasSubstr(std::to_string(kViews) + " keyframes"));
      EXPECT_GT(saved.points, 100u);
      points[name] = saved.points;
      expect_header(name, header);
      if (format == SaveMap::Request::PLY) {
        EXPECT_EQ(ReadPly(PathOf(name)).vertices.size(), saved.points);
      }
    }
  }
  EXPECT_EQ(points["map.pcd"], points["map.ply"]);
  EXPECT_EQ(points["mesh.obj"], points["mesh.ply"]);
  const TriangleMesh mesh = ReadPly(PathOf("mesh.ply"));
  EXPECT_EQ(mesh.vertices.size(), points["mesh.ply"]);
  EXPECT_GT(mesh.triangles.size(), 100u);
}

TEST_F(ServicesTest, SaveMapSaysWhatIsNotInTheMapYet) {
  mapper().depth.Clear();
  for (const ViewMessages& view : Scene()) mapper().player.Publish(view);
  ASSERT_TRUE(mapper().depth.WaitForCount(kViews - 2)) << "all but the lookahead";
  EXPECT_THAT(mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true).message,
              HasAll("images were still under way in /dense_mapper", "flush"));
  std::string flushed;
  ASSERT_TRUE(mapper().Call("flush", &flushed));
  EXPECT_THAT(flushed, HasSubstr("0 under way"));
  const SaveMap::Response whole = mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true);
  EXPECT_EQ(whole.keyframes, kViews);
  EXPECT_THAT(whole.message, AllOf(Not(HasSubstr("under way")), Not(HasSubstr("lost"))));
}

TEST_F(ServicesTest, AfterAFlushAnImageWithoutAPoseIsNotUnderWay) {
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews + 1, StartS());
  for (size_t i = 0; i < kViews; ++i) mapper().player.Publish(scene[i]);
  mapper().player.image.publish(scene[kViews].image);
  std::string message;
  ASSERT_TRUE(mapper().Call("flush", &message));
  EXPECT_THAT(message, HasSubstr("1 image(s) still wait"));
  const SaveMap::Response saved = mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true);
  EXPECT_EQ(saved.keyframes, kViews);
  EXPECT_THAT(saved.message, Not(HasSubstr("under way")));
}

TEST_F(ServicesTest, WhoSubscribesLateGetsTheNewestImages) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  const ros::Time newest = mapper().depth.messages().back()->header.stamp;
  for (const char* topic : {"rgb/image_rect_color", "depth/image_raw", "depth/image_vis", "normal/image",
                            "normal/image_vis", "confidence/image", "confidence/image_vis"}) {
    Recorder<sensor_msgs::Image> late(mapper().nh, topic);
    ASSERT_TRUE(late.WaitForCount(1)) << topic;
    EXPECT_EQ(late.messages()[0]->header.stamp, newest) << topic;
    Recorder<sensor_msgs::Image> later(mapper().nh, topic);  // in one process: the publisher does not hear of it
    ASSERT_TRUE(later.WaitForCount(1)) << topic;
    EXPECT_EQ(later.messages()[0]->header.stamp, newest) << topic;
  }
  for (const char* topic : {"rgb/camera_info", "depth/camera_info"}) {
    Recorder<sensor_msgs::CameraInfo> late(mapper().nh, topic);
    ASSERT_TRUE(late.WaitForCount(1)) << topic;
    EXPECT_EQ(late.messages()[0]->header.stamp, newest) << topic;
  }
}

TEST_F(ServicesTest, AfterAResetNobodyGetsImagesOfTheRunBefore) {
  const char* topics[] = {"confidence/image_vis", "depth/image_vis", "normal/image"};
  {
    // For these roscpp holds what was sent last, also when they are gone.
    Recorder<sensor_msgs::Image> confidence(mapper().nh, topics[0]), depth(mapper().nh, topics[1]);
    ASSERT_TRUE(confidence.WaitForPublisher() && depth.WaitForPublisher());
    ASSERT_EQ(mapper().Map(Scene()), kViews);
    ASSERT_TRUE(confidence.WaitForCount(kViews) && depth.WaitForCount(kViews));
  }
  ASSERT_TRUE(mapper().Call("reset"));
  std::vector<std::unique_ptr<Recorder<sensor_msgs::Image>>> late;
  for (const char* topic : topics) {
    late.push_back(std::make_unique<Recorder<sensor_msgs::Image>>(mapper().nh, topic));
    ASSERT_TRUE(late.back()->WaitForPublisher()) << topic;
  }
  const std::vector<ViewMessages> next = MakeSmallScene(kViews, StartS() + 50);
  ASSERT_EQ(mapper().Map(next), kViews) << "who listened to depth goes on";
  for (const auto& recorder : late) {
    ASSERT_TRUE(recorder->WaitForCount(1));
    EXPECT_GE(recorder->messages()[0]->header.stamp, next[0].image.header.stamp);
  }
}

TEST_F(ServicesTest, SaveMapRefusesBadPathsAndFormatsAndFindsRelativeOnes) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  const std::string top = fs::canonical(fs::temp_directory_path()).string();
  const auto refusal = [&](const std::string& path, uint8_t format) {
    const SaveMap::Response response = mapper().SaveMap(path, format, true);
    EXPECT_FALSE(response.success) << path;
    return response.message;
  };
  EXPECT_THAT(refusal(PathOf("map.pcd"), SaveMap::Request::PLY), HasSubstr("must end in .ply"));
  EXPECT_THAT(refusal(PathOf("map.ot"), SaveMap::Request::OCTOMAP), HasSubstr("must end in .bt"));
  EXPECT_THAT(refusal(PathOf("map.xyz"), 7), HasSubstr("7"));
  EXPECT_THAT(refusal("../map.ply", SaveMap::Request::PLY),
              HasSubstr("must lie below " + top + ", the parameter save_folder"));
  EXPECT_TRUE(fs::is_empty(folder_));
  const std::string relative = fs::relative(PathOf("map.ply"), top).string();
  const SaveMap::Response response = mapper().SaveMap(relative, SaveMap::Request::PLY, true);
  EXPECT_THAT(response.message, HasSubstr("keyframes to " + (fs::path(top) / relative).string()));
  EXPECT_EQ(ReadPly(PathOf("map.ply")).vertices.size(), response.points);
}

TEST_F(ServicesTest, ResetOfTheMapperKeepsTheMap) {
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  ASSERT_TRUE(mapper().Call("reset"));
  const SaveMap::Response once = mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true);
  EXPECT_EQ(once.keyframes, kViews);
  EXPECT_EQ(mapper().Map(Scene()), kViews) << "the same stamps again, which nobody remembers";
  const SaveMap::Response twice = mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true);
  EXPECT_EQ(twice.keyframes, 2 * kViews) << "keyframes of another run";
  EXPECT_EQ(twice.points, once.points) << "in the same places";
}

TEST_F(ServicesTest, AHundredInventedMappersLockNoneOut) {
  ros::Publisher publisher = mapper().nh.advertise<acmp_mapping::KeyframePoints>("keyframe_points", 1000);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  KeyframePointsHead head;
  head.pose.camera = {64, 48, 50, 50, 31.5, 23.5};
  head.world_frame = kWorldFrame;
  for (int i = 0; i <= 100; ++i) {
    head.key = {"/mapper_" + std::to_string(i), 1, 1};
    acmp_mapping::KeyframePointsPtr message = ToKeyframePoints(head, {{{0, 0, 1}, {0, 0, -1}, {}, 0, 1}});
    message->count = 1;
    publisher.publish(message);
  }
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  EXPECT_EQ(mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true).keyframes, kViews + 101);
}

TEST_F(ServicesTest, PublishMapPublishesOnRequest) {
  Recorder<sensor_msgs::PointCloud2> map(mapper().nh, "map_points");
  ASSERT_TRUE(map.WaitForPublisher());
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  std::string message;
  ASSERT_TRUE(mapper().CallMap("publish_map", &message));
  const auto stamp = Scene().back().image.header.stamp;
  ASSERT_TRUE(map.WaitForNewest([&](const auto& newest) { return newest.header.stamp == stamp; }));
  EXPECT_THAT(message, HasSubstr(std::to_string(map.messages().back()->width)));
  const auto of_this_case = [&](const auto& m) { return m->header.stamp >= Scene().front().image.header.stamp; };
  const auto maps = map.messages();
  EXPECT_EQ(std::count_if(maps.begin(), maps.end(), of_this_case), 1) << "map_publish_rate is 0";
  Recorder<nav_msgs::OccupancyGrid> occupancy(mapper().nh, "occupancy");
  EXPECT_TRUE(occupancy.WaitForNewest([&](const auto& newest) { return newest.header.stamp == stamp; }));
}

TEST_F(ServicesTest, PauseDropsImagesAndSaysSo) {
  std_srvs::SetBool pause;
  pause.request.data = true;
  ASSERT_TRUE(CallService("/dense_mapper/pause", &pause));
  for (const ViewMessages& view : Scene()) mapper().player.Publish(view);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: paused"}));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"paused (~pause)"}));
  pause.request.data = false;
  ASSERT_TRUE(CallService("/dense_mapper/pause", &pause));
  EXPECT_EQ(mapper().Map(MakeSmallScene(kViews, 900000)), kViews);
}

TEST_F(ServicesTest, ReconfigureChangesTheNextKeyframesOrNothing) {
  const auto before = Reconfigure([](dynamic_reconfigure::Config*) {});
  ASSERT_EQ(mapper().Map(Scene()), kViews);
  const uint32_t all = mapper().SaveMap(PathOf("all.ply"), SaveMap::Request::PLY, true).points;
  const auto points_with = [&](double min_confidence) {
    const auto config = Reconfigure(
        [=](dynamic_reconfigure::Config* c) { ConfigTools::appendParameter(*c, "min_confidence", min_confidence); });
    EXPECT_EQ(config.min_confidence, min_confidence);
    Reset();
    EXPECT_EQ(mapper().Map(Scene()), kViews);
    return mapper().SaveMap(PathOf("map.ply"), SaveMap::Request::PLY, true).points;
  };
  EXPECT_LT(points_with(0.9), all);
  const auto refused = Reconfigure([](dynamic_reconfigure::Config* c) {
    ConfigTools::appendParameter(*c, "max_source_views", 2000);
    ConfigTools::appendParameter(*c, "min_confidence", 0.5);
  });
  EXPECT_EQ(refused.max_source_views, before.max_source_views);
  EXPECT_EQ(refused.min_confidence, 0.9) << "all or nothing";
  EXPECT_TRUE(mapper().WaitForLog({"max_source_views = 2000", "[1, 32]"}));
  EXPECT_EQ(points_with(before.min_confidence), all) << "the same input and options";
}

}  // namespace acmp::test::services_rostest
