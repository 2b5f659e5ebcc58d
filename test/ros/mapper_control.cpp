#include "ros/mapper_control.h"

#include <algorithm>
#include <set>

#include <std_srvs/Trigger.h>

namespace acmp::test {
namespace {

bool ContainsAll(const std::string& text, const std::vector<std::string>& parts) {
  return std::all_of(parts.begin(), parts.end(),
                     [&](const std::string& part) { return text.find(part) != std::string::npos; });
}

bool CallTrigger(const std::string& service, std::string* message) {
  std_srvs::Trigger trigger;
  if (!ros::service::call(service, trigger)) return false;
  if (message) *message = trigger.response.message;
  return trigger.response.success;
}

}  // namespace

std::vector<ViewMessages> MakeSmallScene(size_t views, uint32_t start_s, int width) {
  SyntheticSceneOptions scene;
  scene.width = width;
  scene.height = 3 * width / 4;
  scene.keyframes = static_cast<int>(views);
  std::vector<ViewMessages> messages;
  for (const SyntheticView& view : MakeSyntheticScene(scene)) {
    messages.push_back(MakeMessages(view, StampOf(messages.size(), start_s)));
  }
  return messages;
}

MapperControl::MapperControl() { spinner.start(); }

bool MapperControl::WaitUntilReady(double timeout_s) {
  return player.WaitForMapper(timeout_s) && depth.WaitForPublisher(timeout_s) &&
         keyframe_pose.WaitForPublisher(timeout_s) && log.WaitForPublisher(timeout_s) &&
         diagnostics.WaitForCount(1, timeout_s) &&
         ros::service::waitForService("/dense_mapper/flush", ros::Duration(timeout_s));
}

size_t MapperControl::Map(const std::vector<ViewMessages>& messages) {
  depth.Clear();
  keyframe_pose.Clear();
  std::set<ros::Time> sent;
  for (const ViewMessages& view : messages) {
    sent.insert(view.image.header.stamp);
    player.Publish(view);
  }
  const auto all_seen = [&sent](const auto& received) {
    std::set<ros::Time> seen;
    for (const auto& message : received) {
      if (sent.count(message->header.stamp) > 0) seen.insert(message->header.stamp);
    }
    return seen.size() == sent.size();
  };
  // A flush before all have arrived would finish early ones with fewer views.
  if (!keyframe_pose.WaitUntil(all_seen, kTimeoutS) || !Call("flush")) return 0;
  depth.WaitUntil(all_seen, kTimeoutS);
  size_t mapped = 0;
  for (const auto& message : depth.messages()) mapped += sent.count(message->header.stamp);
  return mapped;
}

bool MapperControl::WaitForMapServer(double timeout_s) {
  // Both ends must know of the connection.
  return ros::service::waitForService("/map_server/save_map", ros::Duration(timeout_s)) &&
         WaitForDiagnostic({"maps that get its points = 1"}, timeout_s) &&
         WaitForDiagnostic({"publishers of /keyframe_points = 1"}, timeout_s);
}

bool MapperControl::Call(const std::string& service, std::string* message) {
  return CallTrigger("/dense_mapper/" + service, message);
}

bool MapperControl::CallMap(const std::string& service, std::string* message) {
  return CallTrigger("/map_server/" + service, message);
}

acmp_mapping::SaveMap::Response MapperControl::SaveMap(const std::string& path, uint8_t format, bool binary) {
  acmp_mapping::SaveMap save;
  save.request.path = path;
  save.request.format = format;
  save.request.binary = binary;
  if (!ros::service::call("/map_server/save_map", save)) save.response.message = "(no answer)";
  return save.response;
}

bool MapperControl::WaitForLog(const std::vector<std::string>& parts, double timeout_s) {
  return log.WaitUntil(
      [&](const std::vector<rosgraph_msgs::LogConstPtr>& lines) {
        return std::any_of(lines.begin(), lines.end(), [&](const auto& line) { return ContainsAll(line->msg, parts); });
      },
      timeout_s);
}

bool MapperControl::WaitForDiagnostic(const std::vector<std::string>& parts, double timeout_s) {
  return diagnostics.WaitUntil(
      [&](const std::vector<diagnostic_msgs::DiagnosticArrayConstPtr>& arrays) {
        for (const auto& array : arrays) {
          for (const auto& status : array->status) {
            if (ContainsAll(status.message, parts)) return true;
            for (const auto& value : status.values) {
              if (ContainsAll(value.key + " = " + value.value, parts)) return true;
            }
          }
        }
        return false;
      },
      timeout_s);
}

std::string MapperControl::DiagnosticValue(const std::string& key) {
  std::string found;
  for (const auto& array : diagnostics.messages()) {
    for (const auto& status : array->status) {
      for (const auto& value : status.values) {
        if (value.key == key) found = value.value;
      }
    }
  }
  return found;
}

}  // namespace acmp::test
