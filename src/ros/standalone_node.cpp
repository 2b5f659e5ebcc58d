#include "standalone_node.h"

#include <atomic>
#include <csignal>

#include <nodelet/loader.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>

namespace acmp {
namespace {

std::atomic<bool> g_stop{false};

void HandleSignal(int /*signal*/) { g_stop = true; }

}  // namespace

int RunStandalone(int argc, char** argv, const char* default_name, const char* nodelet_type) {
  ros::init(argc, argv, default_name, ros::init_options::NoSigintHandler);
  // roscpp handles SIGINT only; roslaunch and systemd end programs with SIGTERM.
  std::signal(SIGINT, HandleSignal);
  std::signal(SIGTERM, HandleSignal);
  ros::NodeHandle keep_ros_alive;
  {
    // The loader's destructor ends the nodelet and joins its threads while ROS is still up.
    nodelet::Loader loader(false);
    if (!loader.load(ros::this_node::getName(), nodelet_type, ros::names::getRemappings(),
                     nodelet::V_string(argv + 1, argv + argc))) {
      return 1;
    }
    while (ros::ok() && !g_stop) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
  }
  ros::shutdown();
  return 0;
}

}  // namespace acmp
