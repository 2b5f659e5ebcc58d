#include "ros/mapper_control.h"

#include <unistd.h>

#include <algorithm>
#include <set>

#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/common/error.h"

namespace acmp::test {
namespace {

namespace fs = std::filesystem;

bool ContainsAll(const std::string& text, const std::vector<std::string>& parts) {
  return std::all_of(parts.begin(), parts.end(),
                     [&](const std::string& part) { return text.find(part) != std::string::npos; });
}

/// Whether function(status, key, value) holds for one of them; the message of a status has the key "".
template <class Function>
bool AnyOf(const std::vector<diagnostic_msgs::DiagnosticArrayConstPtr>& arrays, const ros::Time& since,
           const Function& function) {
  for (const auto& array : arrays) {
    if (array->header.stamp < since) continue;
    for (const auto& status : array->status) {
      if (function(status.name, std::string(), status.message)) return true;
      for (const auto& value : status.values) {
        if (function(status.name, value.key, value.value)) return true;
      }
    }
  }
  return false;
}

bool CallTrigger(const std::string& service, std::string* message) {
  std_srvs::Trigger trigger;
  if (!CallService(service, &trigger)) return false;
  if (message) *message = trigger.response.message;
  return trigger.response.success;
}

}  // namespace

std::vector<ViewMessages> MakeSmallScene(size_t views, uint32_t start_s, int width) {
  SyntheticSceneOptions scene = {width, 3 * width / 4, static_cast<int>(views)};
  std::vector<ViewMessages> messages;
  for (const SyntheticView& view : MakeSyntheticScene(scene)) {
    messages.push_back(MakeMessages(view, StampOf(messages.size(), start_s)));
  }
  return messages;
}

bool LoadNodelet(const std::string& name, const std::string& type, const std::map<std::string, std::string>& remap) {
  nodelet::NodeletLoad load;
  load.request.name = name;
  load.request.type = "acmp_mapping/" + type;
  for (const auto& [from, to] : remap) {
    load.request.remap_source_args.push_back(from);
    load.request.remap_target_args.push_back(to);
  }
  return ros::service::waitForService("/manager/load_nodelet", ros::Duration(kTimeoutS)) &&
         CallService("/manager/load_nodelet", &load) && load.response.success;
}

bool UnloadNodelet(const std::string& name) {
  nodelet::NodeletUnload unload;
  unload.request.name = name;
  return CallService("/manager/unload_nodelet", &unload) && unload.response.success;
}

LoadedNodelets::LoadedNodelets(const Parameters& mapper, const std::optional<Parameters>& map_server,
                               const std::string& ns) {
  if (map_server) LoadMapServer(ns + "/map_server", *map_server);
  LoadMapper(ns + "/dense_mapper", mapper);
}

void LoadedNodelets::LoadMapper(const std::string& name, Parameters parameters,
                                const std::map<std::string, std::string>& remap) {
  parameters.insert({{"device", std::string("cpu")},
                     {"overload", std::string("block")},
                     {"preset", std::string("online")},
                     {"sparse_wait", 10.0}});
  Load(name, "DenseMapperNodelet", parameters, remap);
}

void LoadedNodelets::LoadMapServer(const std::string& name, const Parameters& parameters,
                                   const std::map<std::string, std::string>& remap) {
  Load(name, "MapServerNodelet", parameters, remap);
}

void LoadedNodelets::Load(const std::string& name, const std::string& type, const Parameters& parameters,
                          const std::map<std::string, std::string>& remap) {
  for (const auto& [parameter, value] : parameters) ros::param::set(name + "/" + parameter, value);
  EXPECT_TRUE(LoadNodelet(name, type, remap)) << name;
  names_.push_back(name);
}

LoadedNodelets::~LoadedNodelets() {
  for (const std::string& name : names_) {
    EXPECT_TRUE(UnloadNodelet(name)) << name;
    ros::param::del(name);
  }
}

bool WaitForSubscriber(const ros::Publisher& publisher, uint32_t count) {
  return WaitUntil([&] { return publisher.getNumSubscribers() >= count; });
}

MapperControl::MapperControl(const std::string& ns) : ns(ns) { spinner.start(); }

MapperControl::MapperControl(const Parameters& mapper, const std::optional<Parameters>& map_server,
                             const std::string& ns)
    : MapperControl(ns) {
  nodelets_.emplace(mapper, map_server, ns);
}

bool MapperControl::WaitForOutputs() {
  return depth.WaitForPublisher() && keyframe_pose.WaitForPublisher() && log.WaitForPublisher() &&
         diagnostics_.WaitForPublisher() &&
         ros::service::waitForService(ns + "/dense_mapper/flush", ros::Duration(kTimeoutS));
}

bool MapperControl::WaitUntilReady() { return player.WaitForMapper() && WaitForOutputs(); }

size_t MapperControl::Map(const std::vector<ViewMessages>& messages, std::optional<size_t> expected) {
  depth.Clear();
  keyframe_pose.Clear();
  std::set<ros::Time> sent;
  for (const ViewMessages& view : messages) {
    sent.insert(view.image.header.stamp);
    player.Publish(view);
  }
  const auto all_seen = [&](const auto& received) {
    std::set<ros::Time> seen;
    for (const auto& message : received) {
      if (sent.count(message->header.stamp) > 0) seen.insert(message->header.stamp);
    }
    return seen.size() == expected.value_or(sent.size());
  };
  // A flush before all have arrived would finish early ones with fewer views.
  if (!keyframe_pose.WaitUntil(all_seen) || !Call("flush")) return 0;
  depth.WaitUntil(all_seen);
  size_t mapped = 0;
  for (const auto& message : depth.messages()) mapped += sent.count(message->header.stamp);
  return mapped;
}

bool MapperControl::SendAndFlush(const std::vector<ViewMessages>& messages) {
  for (const ViewMessages& view : messages) player.Publish(view);
  sent_ += messages.size();
  const std::string status = (ns.empty() ? "" : ns.substr(1) + "/") + "dense_mapper: inputs";
  for (const char* topic : {"/image", "/camera_info", "/pose", "/sparse_points"}) {
    if (!WaitForValue(status, ns + topic, Concat(sent_, " received"))) return false;
  }
  return Call("flush");
}

bool MapperControl::WaitForMapServer() {
  // Both ends must know of the connection.
  return ros::service::waitForService("/map_server/save_map", ros::Duration(kTimeoutS)) &&
         WaitForDiagnostic({"maps that get its points = 1"}) &&
         WaitForDiagnostic({"publishers of /keyframe_points = 1"});
}

bool MapperControl::Call(const std::string& service, std::string* message) {
  const bool done = CallTrigger(ns + "/dense_mapper/" + service, message);
  ForgetDiagnostics();
  return done;
}

bool MapperControl::CallMap(const std::string& service, std::string* message) {
  const bool done = CallTrigger(ns + "/map_server/" + service, message);
  ForgetDiagnostics();
  return done;
}

acmp_mapping::SaveMap::Response MapperControl::SaveMap(const std::string& path, uint8_t format, bool binary) {
  acmp_mapping::SaveMap save;
  save.request.path = path;
  save.request.format = format;
  save.request.binary = binary;
  if (!CallService("/map_server/save_map", &save)) save.response.message = "(no answer)";
  return save.response;
}

bool MapperControl::WaitForLog(const std::vector<std::string>& parts) {
  return log.WaitUntil([&](const std::vector<rosgraph_msgs::LogConstPtr>& lines) {
    return std::any_of(lines.begin(), lines.end(), [&](const auto& line) { return ContainsAll(line->msg, parts); });
  });
}

bool MapperControl::WaitForDiagnostic(const std::vector<std::string>& parts) {
  return diagnostics_.WaitUntil([&](const auto& arrays) {
    return AnyOf(arrays, told_since_, [&](const auto& /*status*/, const auto& key, const auto& value) {
      return ContainsAll(key + " = " + value, parts);
    });
  });
}

bool MapperControl::WaitForValue(const std::string& status, const std::string& key, const std::string& start) {
  return diagnostics_.WaitUntil([&](const auto& arrays) {
    return AnyOf(arrays, told_since_, [&](const auto& name, const auto& found, const auto& value) {
      return name == status && found == key && value.rfind(start, 0) == 0;
    });
  });
}

std::string MapperControl::DiagnosticValue(const std::string& status, const std::string& key) {
  EXPECT_TRUE(WaitForValue(status, "", "")) << status;
  std::string newest;
  AnyOf(diagnostics_.messages(), told_since_, [&](const auto& name, const auto& found, const auto& value) {
    if (name == status && found == key) newest = value;
    return false;
  });
  return newest;
}

SavingSession::SavingSession()
    : MapperControl(Parameters{{"keep_images", 48}},
                    Parameters{{"map_publish_rate", 0.0}, {"save_folder", fs::temp_directory_path().string()}}) {}

SavingTest::SavingTest() : folder_(fs::temp_directory_path() / Concat("acmp_saving_test_", ::getpid())) {}

void SavingTest::SetUp() {
  ASSERT_TRUE(session().ready);
  Reset();
  fs::remove_all(folder_);
  fs::create_directories(folder_);
}

void SavingTest::Reset() { ASSERT_TRUE(mapper().Call("reset") && mapper().CallMap("reset")); }

}  // namespace acmp::test
