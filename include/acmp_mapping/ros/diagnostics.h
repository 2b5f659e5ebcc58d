#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

namespace acmp {

/// Publishes statuses that are all made of one snapshot on /diagnostics, once a second of wall time, so that a paused
/// or jumping clock does not silence them.
template <class Snapshot>
class Diagnostics {
 public:
  using Describe = void (*)(const Snapshot&, diagnostic_updater::DiagnosticStatusWrapper*);
  using Statuses = std::vector<std::pair<const char*, Describe>>;  ///< names, and what describes each

  Diagnostics(ros::NodeHandle nh, const ros::NodeHandle& private_nh, const std::string& name,
              std::function<Snapshot()> take_snapshot, const Statuses& statuses)
      : take_snapshot_(std::move(take_snapshot)), updater_(nh, private_nh, name), snapshot_(take_snapshot_()) {
    updater_.setHardwareID("none");
    for (const auto& [status_name, describe] : statuses) {
      updater_.add(status_name, [this, describe = describe](diagnostic_updater::DiagnosticStatusWrapper& status) {
        describe(snapshot_, &status);
      });
    }
    timer_ = nh.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) {
      snapshot_ = take_snapshot_();
      updater_.force_update();
    });
  }

 private:
  std::function<Snapshot()> take_snapshot_;
  diagnostic_updater::Updater updater_;
  Snapshot snapshot_;
  ros::WallTimer timer_;
};

}  // namespace acmp
