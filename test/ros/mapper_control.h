#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include <acmp_mapping/SaveMap.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/Image.h>

#include "ros/recorder.h"
#include "ros/scene_player.h"

namespace acmp::test {

/// A scene small enough that a keyframe takes a fraction of a second: what it looks like does not matter to these
/// tests.
std::vector<ViewMessages> MakeSmallScene(size_t views, uint32_t start_s = 1000, int width = 64);

/// A mapper named /dense_mapper and perhaps its map, /map_server, seen from outside: their inputs, services, log and
/// diagnostics.
class MapperControl {
 public:
  MapperControl();

  /// Everything connected; false after `timeout_s`.
  bool WaitUntilReady(double timeout_s);

  /// The map server is there and gets what the mapper finishes from now on; false after `timeout_s`.
  bool WaitForMapServer(double timeout_s);

  /// Publishes all views and flushes when all are in the mapper; the number of views that got a refined depth image.
  size_t Map(const std::vector<ViewMessages>& messages);

  /// Calls a Trigger service of the mapper; false when there is no answer or the service refuses.
  bool Call(const std::string& service, std::string* message = nullptr);
  /// The same of the map server.
  bool CallMap(const std::string& service, std::string* message = nullptr);
  acmp_mapping::SaveMap::Response SaveMap(const std::string& path, uint8_t format, bool binary);

  /// Waits for a line of the log that contains all the parts.
  bool WaitForLog(const std::vector<std::string>& parts, double timeout_s);

  /// Waits for a diagnostic value or message that contains all the parts.
  bool WaitForDiagnostic(const std::vector<std::string>& parts, double timeout_s);

  /// Latest value of a key, "" when there is none.
  std::string DiagnosticValue(const std::string& key);

  ros::NodeHandle nh;
  ros::AsyncSpinner spinner{1};
  ScenePlayer player{nh};
  Recorder<sensor_msgs::Image> depth{nh, "depth/image_rect"};
  Recorder<geometry_msgs::PoseStamped> keyframe_pose{nh, "keyframe_pose"};
  Recorder<rosgraph_msgs::Log> log{nh, "/rosout"};
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics{nh, "/diagnostics"};
};

}  // namespace acmp::test
