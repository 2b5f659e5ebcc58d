#pragma once

#include <functional>
#include <optional>
#include <string>
#include <variant>

#include <ros/subscriber.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// Transforms of /tf and /tf_static. Never waits. Thread-safe.
class TfLookup {
 public:
  /// Listens in the node handle's callback queue.
  /// @param only_static of /tf_static alone, which costs nothing
  /// @param report told of transforms that cannot be used
  TfLookup(ros::NodeHandle nh, bool only_static, std::function<void(const std::string&)> report);

  /// Pose of `child` in `world` at a stamp, between the two transforms around it; or why there is none (yet).
  std::variant<PoseSample, std::string> FindPose(const std::string& world, const std::string& child, int64_t stamp_ns);

  /// The newest pose of `source` in `target`; none while they are not connected.
  std::optional<RigidTransform> FindLatest(const std::string& target, const std::string& source);

  /// Forgets all but static transforms: those of another run would be taken for newer ones.
  void Clear() { buffer_.clear(); }

 private:
  /// tf2's own listener throws in the middle of a message.
  void Receive(const tf2_msgs::TFMessage& message, bool is_static);

  const std::function<void(const std::string&)> report_;
  tf2_ros::Buffer buffer_;
  ros::Time last_received_;
  ros::Subscriber transforms_, static_transforms_;
};

}  // namespace acmp
