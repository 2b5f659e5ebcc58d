#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <acmp_mapping/SaveMap.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/Image.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include "ros/recorder.h"
#include "ros/scene_player.h"

namespace acmp::test {

/// A scene small enough that a keyframe takes a fraction of a second: what it looks like does not matter to these
/// tests.
std::vector<ViewMessages> MakeSmallScene(size_t views, uint32_t start_s = 1000, int width = 64);

/// Of a private namespace.
using Parameters = std::map<std::string, XmlRpc::XmlRpcValue>;

/// Calls a service of the nodelet manager of nodelets_rostest.test.
/// @param remap topics by the names that they would have
bool LoadNodelet(const std::string& name, const std::string& type,
                 const std::map<std::string, std::string>& remap = {});
bool UnloadNodelet(const std::string& name);

/// Nodelets in the manager, as long as this lives.
class LoadedNodelets {
 public:
  LoadedNodelets() = default;
  /// dense_mapper and perhaps map_server, in a namespace.
  explicit LoadedNodelets(const Parameters& mapper, const std::optional<Parameters>& map_server = std::nullopt,
                          const std::string& ns = "");
  ~LoadedNodelets();
  LoadedNodelets(const LoadedNodelets&) = delete;
  LoadedNodelets& operator=(const LoadedNodelets&) = delete;

  /// @param parameters over what suits tests: on the CPU, quick, and nothing is dropped or done without, however busy
  /// the machine is
  void LoadMapper(const std::string& name, Parameters parameters, const std::map<std::string, std::string>& remap = {});
  void LoadMapServer(const std::string& name, const Parameters& parameters,
                     const std::map<std::string, std::string>& remap = {});

 private:
  void Load(const std::string& name, const std::string& type, const Parameters& parameters,
            const std::map<std::string, std::string>& remap);
  std::vector<std::string> names_;
};

/// Waits until so many subscribe to a topic; false after kTimeoutS.
bool WaitForSubscriber(const ros::Publisher& publisher, uint32_t count = 1);

/// Cases that share one session, which is made before the first of them and gone after the last.
template <class Session>
class SessionTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { session_ = std::make_unique<Session>(); }
  static void TearDownTestSuite() { session_.reset(); }
  static Session& session() { return *session_; }

 private:
  inline static std::unique_ptr<Session> session_;
};

/// A mapper named dense_mapper and perhaps its map, map_server, in a namespace, seen from outside: their inputs,
/// services, log and diagnostics.
class MapperControl {
 public:
  explicit MapperControl(const std::string& ns = "");
  /// With the nodelets.
  explicit MapperControl(const Parameters& mapper, const std::optional<Parameters>& map_server = std::nullopt,
                         const std::string& ns = "");

  /// Everything connected; false after kTimeoutS, as all that follow.
  bool WaitUntilReady();
  /// The same, but for what the player sends.
  bool WaitForOutputs();

  /// The map server is there and gets what the mapper finishes from now on.
  bool WaitForMapServer();

  /// Publishes all views and flushes when all are in the mapper; the number of views that got a refined depth image.
  /// @param expected views that do; by default all
  size_t Map(const std::vector<ViewMessages>& messages, std::optional<size_t> expected = std::nullopt);
  /// The same of views of which it is not known what becomes: flushes when all that was ever sent, in this way, has
  /// arrived. False when that fails.
  bool SendAndFlush(const std::vector<ViewMessages>& messages);

  /// Calls a Trigger service of the mapper; false when there is no answer or the service refuses.
  bool Call(const std::string& service, std::string* message = nullptr);
  /// The same of the map server.
  bool CallMap(const std::string& service, std::string* message = nullptr);
  acmp_mapping::SaveMap::Response SaveMap(const std::string& path, uint8_t format, bool binary);

  /// Waits for a line of the log that contains all the parts.
  bool WaitForLog(const std::vector<std::string>& parts);

  /// Diagnostics of before tell nothing from now on. What calls a service, or maps, does this itself at its end.
  void ForgetDiagnostics() { told_since_ = ros::Time::now(); }

  /// Waits for a diagnostic value or message that contains all the parts.
  bool WaitForDiagnostic(const std::vector<std::string>& parts);
  /// Waits until a status ("a/node: task") has a value that begins so.
  bool WaitForValue(const std::string& status, const std::string& key, const std::string& start);
  /// Waits for a status; its newest value of a key, "" when there is none.
  std::string DiagnosticValue(const std::string& status, const std::string& key);

  const std::string ns;
  ros::NodeHandle nh{ns};
  ros::AsyncSpinner spinner{1};
  ScenePlayer player{nh};
  Recorder<sensor_msgs::Image> depth{nh, "depth/image_rect"};
  Recorder<geometry_msgs::PoseStamped> keyframe_pose{nh, "keyframe_pose"};
  Recorder<rosgraph_msgs::Log> log{nh, "/rosout"};

 private:
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics_{nh, "/diagnostics"};
  ros::Time told_since_;  ///< stamp of the first diagnostics that count
  size_t sent_ = 0;       ///< images, by SendAndFlush
  std::optional<LoadedNodelets> nodelets_;
};

/// Cases of one mapper, each of which is a run of its own: later stamps, and nothing left in the mapper. `Session` is a
/// MapperControl with `ready`.
template <class Session>
class RunsTest : public SessionTest<Session> {
 protected:
  void SetUp() override {
    ASSERT_TRUE(mapper().ready);
    start_s_ += 100;
    ASSERT_TRUE(mapper().Call("reset"));
  }
  static Session& mapper() { return SessionTest<Session>::session(); }
  /// Views at the stamps of this run.
  static std::vector<ViewMessages> OfThisRun(std::vector<ViewMessages> views) {
    for (size_t i = 0; i < views.size(); ++i) SetStamp(StampOf(i, start_s_), &views[i]);
    return views;
  }

  inline static uint32_t start_s_ = 1000;
};

/// Mapper and map, which saves below the folder for temporary files and is not published by itself.
struct SavingSession : MapperControl {
  SavingSession();
  const bool ready = WaitUntilReady() && WaitForMapServer();
};

/// Each case begins with nothing in mapper and map, and an empty folder.
class SavingTest : public SessionTest<SavingSession> {
 protected:
  void SetUp() override;
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static MapperControl& mapper() { return session(); }
  /// Mapper and map.
  static void Reset();
  std::string PathOf(const std::string& name) const { return (folder_ / name).string(); }

  const std::filesystem::path folder_;

 public:
  SavingTest();
};

}  // namespace acmp::test
