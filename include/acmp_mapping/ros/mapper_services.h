#pragma once

#include <functional>
#include <string>

#include <acmp_mapping/SaveMap.h>
#include <ros/node_handle.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

namespace acmp {

/// The services and a periodic task. They may take as long as a map takes to write: give them a thread of their own.
class MapperServices {
 public:
  /// A trigger returns what it did; failures are exceptions whose text becomes the response's message. A service
  /// without a handler does not exist.
  struct Handlers {
    std::function<std::string()> flush;
    std::function<std::string()> reset;
    std::function<std::string()> publish_map;
    std::function<std::string(bool)> pause;
    /// Returns the number of points written.
    std::function<size_t(const acmp_mapping::SaveMap::Request&)> save_map;
    std::function<void()> periodic;
  };

  MapperServices(ros::NodeHandle private_nh, double period_s, Handlers handlers);

 private:
  using Trigger = std_srvs::Trigger;
  bool Run(const std::function<std::string()>& handler, Trigger::Response* response) const;

  Handlers handlers_;
  ros::ServiceServer flush_, reset_, publish_map_, pause_, save_map_;
  ros::WallTimer timer_;
};

}  // namespace acmp
