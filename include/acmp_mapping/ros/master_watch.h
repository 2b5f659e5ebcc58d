#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "acmp_mapping/ros/callback_thread.h"

namespace acmp {

/// Notices that the ROS master was restarted and registers this process with the new one. roscpp registers a topic or a
/// service once: after a restart of the master nobody would find them again, and the map with them. Asks the master
/// once a second, in a thread of its own: a call may take as long as the master takes to answer.
class MasterWatch {
 public:
  /// @param report told what the user should know; runs in the thread
  MasterWatch(const ros::NodeHandle& nh, std::function<void(const std::string&)> report);

  void Start() { thread_.Start(); }
  /// Nothing is reported afterwards.
  void Stop() { thread_.Stop(); }

 private:
  void Check();
  /// Whether another process has this one's name at the new master, which would end one of the two: another one that
  /// was started while this one was left over. Told once.
  bool IsReplaced();
  void ReadRegistrations();
  bool Register();

  CallbackThread thread_;  ///< first: the timer goes before it does
  std::function<void(const std::string&)> report_;
  int master_pid_ = 0;  ///< 0 = never seen
  bool reachable_ = true;
  bool replaced_ = false;
  int checks_ = 0, checks_of_new_ = 0;               ///< of a master that was seen before, and of a new one
  std::map<std::string, std::string> publications_;  ///< topic to type
  std::vector<std::string> subscriptions_;
  std::vector<std::string> services_;
  ros::WallTimer timer_;
};

}  // namespace acmp
