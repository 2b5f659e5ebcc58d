#pragma once

#include <map>
#include <string>
#include <vector>

namespace acmp {

/// Notices that the ROS master was restarted and registers this process with the new one. roscpp registers a topic or a
/// service once: after a restart of the master nobody would find them again, and the map with them. Not thread-safe; a
/// call may take as long as the master takes to answer.
class MasterWatch {
 public:
  enum class Event {
    kNone,
    kGone,       ///< the master cannot be reached; connections that exist go on
    kBack,       ///< the same master answers again
    kRestarted,  ///< another master answers, and everything is registered with it
  };

  /// Asks the master; to be called about once a second.
  Event Check();

  size_t topics() const { return publications_.size() + subscriptions_.size(); }
  size_t services() const { return services_.size(); }

 private:
  void ReadRegistrations();
  bool Register() const;

  int master_pid_ = 0;  ///< 0 = never seen
  bool reachable_ = true;
  int checks_ = 0;
  std::map<std::string, std::string> publications_;  ///< topic to type
  std::vector<std::string> subscriptions_;
  std::vector<std::string> services_;
};

}  // namespace acmp
