// Loading and unloading the nodelet in a manager while data flows, and refusing to start with bad parameters.

#include <fcntl.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <nodelet/NodeletList.h>
#include <std_srvs/Trigger.h>
#include <sys/wait.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "ros/mapper_control.h"

namespace acmp::test::lifecycle_rostest {

constexpr char kName[] = "/dense_mapper";
constexpr char kMapName[] = "/map_server";

bool Load() { return LoadNodelet(kName, "DenseMapperNodelet"); }
bool LoadMap() { return LoadNodelet(kMapName, "MapServerNodelet"); }
bool Unload(const char* name = kName) { return UnloadNodelet(name); }

std::vector<std::string> LoadedNames() {
  nodelet::NodeletList list;
  EXPECT_TRUE(CallService("/manager/list", &list)) << "the manager is dead";
  return list.response.nodelets;
}

/// Publishes the scene over and over, as a looping bag does, until destroyed.
class EndlessPlayer {
 public:
  explicit EndlessPlayer(const ScenePlayer& player)
      : thread_([this, &player] {
          const std::vector<ViewMessages> scene = MakeSmallScene(12);
          for (size_t i = 0; !stop_; ++i) {
            player.Publish(scene[i % scene.size()]);
            ros::WallDuration(0.02).sleep();
          }
        }) {}
  ~EndlessPlayer() {
    stop_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class LifecycleTest : public SessionTest<MapperControl> {
 protected:
  void SetUp() override {
    ASSERT_TRUE(ros::service::waitForService("/manager/load_nodelet", ros::Duration(kTimeoutS)));
    ASSERT_TRUE(mapper().log.WaitForPublisher());
    ros::param::del(kName);
    ros::param::set(std::string(kName) + "/device", "cpu");
    ros::param::set(std::string(kName) + "/preset", "online");
    mapper().log.Clear();
    mapper().ForgetDiagnostics();
  }
  static void TearDownTestSuite() {
    ros::param::del(kName);
    SessionTest::TearDownTestSuite();
  }
  static MapperControl& mapper() { return session(); }
};

TEST_F(LifecycleTest, LoadsUnloadsAndReloadsWhileDataFlows) {
  const EndlessPlayer player(mapper().player);
  for (int cycle = 0; cycle < 4; ++cycle) {
    ASSERT_TRUE(Load()) << cycle;
    EXPECT_THAT(LoadedNames(), ::testing::Contains(kName));
    mapper().depth.Clear();
    // Every second time it is unloaded before it has made anything.
    if (cycle % 2 == 0) {
      EXPECT_TRUE(mapper().depth.WaitForCount(2)) << "no depth in cycle " << cycle;
    }
    ASSERT_TRUE(Unload()) << cycle;
    EXPECT_THAT(LoadedNames(), ::testing::IsEmpty());
  }
}

TEST_F(LifecycleTest, TheMapComesAndGoesWhileKeyframesAreMapped) {
  const EndlessPlayer player(mapper().player);
  ASSERT_TRUE(Load());
  for (int cycle = 0; cycle < 2; ++cycle) {
    ASSERT_TRUE(LoadMap()) << cycle;
    // Every second time it is unloaded while it is asked for the map.
    Recorder<nav_msgs::Path> path(mapper().nh, "keyframe_path");
    EXPECT_TRUE(path.WaitForCount(2)) << "no keyframes in cycle " << cycle;
    std::thread asking([cycle] {
      std_srvs::Trigger publish;
      if (cycle % 2 == 0) CallService("/map_server/publish_map", &publish);
    });
    EXPECT_TRUE(Unload(kMapName)) << cycle;
    asking.join();
    EXPECT_THAT(LoadedNames(), ::testing::ElementsAre(kName));
    EXPECT_TRUE(mapper().WaitForLog({"keyframes that came after the last save_map", "namespace:="}));
    mapper().log.Clear();
  }
  mapper().depth.Clear();
  EXPECT_TRUE(mapper().depth.WaitForCount(1)) << "the mapper needs no map";
  EXPECT_TRUE(Unload());
}

TEST_F(LifecycleTest, UnloadEndsAFlushThatWaits) {
  const EndlessPlayer player(mapper().player);
  ASSERT_TRUE(Load());
  ASSERT_TRUE(ros::service::waitForService("/dense_mapper/flush", ros::Duration(kTimeoutS)));
  // Each takes a fifth of a second at least. Whether the last one is done, refused or cut off does not matter, only
  // that it ends.
  std::atomic<int> flushed{0};
  std::thread flusher([&flushed] {
    std_srvs::Trigger flush;
    while (CallService("/dense_mapper/flush", &flush)) ++flushed;
  });
  EXPECT_TRUE(WaitUntil([&flushed] { return flushed > 0; })) << "the next one is under way";
  EXPECT_TRUE(Unload());
  flusher.join();
  EXPECT_THAT(LoadedNames(), ::testing::IsEmpty());
}

/// A program beside dense_mapper_node, as a process of its own.
/// @param errors file for its standard error
pid_t StartProgram(const std::string& name, const std::vector<std::string>& arguments,
                   const std::string& errors = "/dev/stderr") {
  const std::string path = std::filesystem::path(ACMP_NODE_PATH).replace_filename(name).string();
  std::vector<char*> words = {const_cast<char*>(path.c_str())};
  for (const std::string& argument : arguments) words.push_back(const_cast<char*>(argument.c_str()));
  words.push_back(nullptr);
  const pid_t child = ::fork();
  if (child != 0) return child;
  const int file = ::open(errors.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  ::dup2(file, STDERR_FILENO);
  ::execv(path.c_str(), words.data());
  ::_exit(127);
}

TEST_F(LifecycleTest, AMapThatASecondStartEndsTellsWhatIsNotSaved) {
  const EndlessPlayer player(mapper().player);
  ASSERT_TRUE(Load());
  const std::filesystem::path errors =
      std::filesystem::temp_directory_path() / Concat("acmp_second_start_", ::getpid());
  const pid_t first = StartProgram("map_server_node", {"__name:=map_server"}, errors.string());
  ASSERT_GT(first, 0);
  Recorder<nav_msgs::Path> path(mapper().nh, "keyframe_path");
  EXPECT_TRUE(path.WaitForCount(1));
  const pid_t second = StartProgram("map_server_node", {"__name:=map_server"});
  ASSERT_GT(second, 0);
  int status = -1;
  EXPECT_EQ(::waitpid(first, &status, 0), first);
  EXPECT_TRUE(WIFEXITED(status));
  std::ifstream file(errors);
  const std::string told((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  EXPECT_THAT(told, ::testing::HasSubstr("keyframes that came after the last save_map"));
  EXPECT_THAT(told, ::testing::HasSubstr("namespace:="));
  ::kill(second, SIGINT);
  EXPECT_EQ(::waitpid(second, &status, 0), second);
  std::filesystem::remove(errors);
  EXPECT_TRUE(Unload());
}

TEST_F(LifecycleTest, StandaloneNodeEndsCleanlyOnSignals) {
  const EndlessPlayer player(mapper().player);
  for (const int signal : {SIGTERM, SIGINT}) {
    const std::string topic = Concat("/keyframe_pose_", signal);  // what comes there is of this one
    Recorder<geometry_msgs::PoseStamped> poses(mapper().nh, topic);
    const pid_t child = StartProgram("dense_mapper_node", {"__name:=dense_mapper", "keyframe_pose:=" + topic});
    ASSERT_GT(child, 0);
    EXPECT_TRUE(poses.WaitForCount(1));
    ::kill(child, signal);
    int status = -1;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
    EXPECT_EQ(WEXITSTATUS(status), 0);
  }
}

TEST_F(LifecycleTest, WarnsOfAnUnknownParameterAndRefusesWhatCannotBe) {
  ros::param::set(std::string(kName) + "/max_imagesize", 320);
  ros::param::set(std::string(kName) + "/window_size", 1);
  EXPECT_FALSE(Load());
  EXPECT_TRUE(mapper().WaitForLog({"~window_size = 1", "[2, 64]"}));
  ros::param::del(std::string(kName) + "/window_size");
  ros::param::set(std::string(kName) + "/source_cameras", 1);
  EXPECT_FALSE(LoadNodelet(kName, "DenseMapperNodelet", {{"/source_image", "/image"}}));
  EXPECT_TRUE(mapper().WaitForLog({"topics image and source_image are both /image: each camera must have its own"}));
  ros::param::del(std::string(kName) + "/source_cameras");
  EXPECT_TRUE(Load()) << "the manager must survive";
  EXPECT_TRUE(mapper().WaitForLog({"~max_imagesize", "~max_image_size"}));
  EXPECT_TRUE(Unload());
}

TEST_F(LifecycleTest, OutlivesTransformsThatTfComputesWithAndThrows) {
  ros::param::set(std::string(kName) + "/pose_child", "body");
  ASSERT_TRUE(Load());
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].header.stamp.sec = std::numeric_limits<uint32_t>::max();
  message.transforms[0].header.frame_id = "body";
  message.transforms[0].child_frame_id = "camera_optical";
  message.transforms[0].transform.rotation.w = 1;
  const ros::Publisher tf = mapper().nh.advertise<tf2_msgs::TFMessage>("/tf", 1, true);
  tf.publish(message);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_tf", "stamp [s] = 4294967295: must be in [0, 4294967264]"}));
  EXPECT_TRUE(Unload());
}

TEST_F(LifecycleTest, ReportsThatThereIsNoGpu) {
  try {
    MakeDepthEngine(Device::kCuda);
    GTEST_SKIP() << "there is a GPU";
  } catch (const InvalidInputError&) {
  }
  ros::param::set(std::string(kName) + "/device", "cuda");
  ASSERT_TRUE(Load());
  EXPECT_TRUE(mapper().WaitForDiagnostic({"no device to match on", "device = cuda"}));
  EXPECT_TRUE(mapper().WaitForLog({"no device to match on", "device = cuda"}));
  {
    const EndlessPlayer player(mapper().player);
    EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_device"}));
  }
  std::string message;
  EXPECT_FALSE(mapper().Call("flush", &message));
  EXPECT_THAT(message, ::testing::HasSubstr("cuda"));
  EXPECT_TRUE(Unload());

  ros::param::set(std::string(kName) + "/device", "auto");
  ros::param::del(std::string(kName) + "/preset");
  mapper().ForgetDiagnostics();
  ASSERT_TRUE(Load());
  EXPECT_TRUE(mapper().WaitForDiagnostic({"why not on a GPU"}));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"mapping on cpu"}));
  EXPECT_TRUE(mapper().WaitForLog({"mapping on cpu", "not on a GPU"}));
  EXPECT_TRUE(mapper().WaitForLog({"preset auto, images of at most"})) << "a CPU that has to keep up";
  EXPECT_TRUE(Unload());
}

}  // namespace acmp::test::lifecycle_rostest
