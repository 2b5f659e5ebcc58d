#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <ros/node_handle.h>

#include "acmp_mapping/ros/callback_thread.h"

namespace acmp {

/// Publishes statuses that are all made of one snapshot on /diagnostics, once a second of wall time, so that a paused
/// or jumping clock does not silence them. Not by diagnostic_updater's Updater, which computes with ROS time and a
/// parameter that anybody may set, and throws for most of their values.
template <class Snapshot>
class Diagnostics {
 public:
  using Describe = void (*)(const Snapshot&, diagnostic_updater::DiagnosticStatusWrapper*);
  using Statuses = std::vector<std::pair<const char*, Describe>>;  ///< names, and what describes each

  /// @param name of the nodelet, with its slash
  Diagnostics(CallbackThread* thread, const ros::NodeHandle& nh, const std::string& name,
              std::function<Snapshot()> take_snapshot, Statuses statuses)
      : name_(name.substr(1)),
        take_snapshot_(std::move(take_snapshot)),
        statuses_(std::move(statuses)),
        publisher_(thread->Attach(nh).template advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1)),
        timer_(thread->MakeTimer(nh, 1.0, [this] { Publish(); })) {}

 private:
  void Publish() {
    const Snapshot snapshot = take_snapshot_();
    diagnostic_msgs::DiagnosticArray message;
    message.header.stamp = ros::Time::now();
    for (const auto& [status_name, describe] : statuses_) {
      diagnostic_updater::DiagnosticStatusWrapper status;
      status.name = name_ + ": " + status_name;
      status.hardware_id = "none";
      describe(snapshot, &status);
      message.status.push_back(status);
    }
    publisher_.publish(message);
  }

  const std::string name_;
  const std::function<Snapshot()> take_snapshot_;
  const Statuses statuses_;
  ros::Publisher publisher_;
  ros::WallTimer timer_;
};

}  // namespace acmp
