#pragma once

#include <functional>
#include <string>

#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/ros/keyframe_intake.h"

namespace acmp {

/// Transforms of /tf and /tf_static. Thread-safe.
class TfLookup {
 public:
  /// @param report told of transforms that cannot be used
  explicit TfLookup(std::function<void(const std::string&)> report);

  /// Receives them in the node handle's callback queue.
  void Listen(const ros::NodeHandle& nh);
  /// tf2's own listener throws in the middle of a message.
  /// @param now of ROS; where that goes back, another run has begun
  void Receive(const tf2_msgs::TFMessage& message, bool is_static, const ros::Time& now);

  /// Looks up here: poses between the two transforms around their stamps. Never waits.
  TransformSource transforms() const;

  /// Forgets all but static transforms: those of another run would be taken for newer ones.
  void Clear() { buffer_.clear(); }

 private:
  const std::function<void(const std::string&)> report_;
  tf2::BufferCore buffer_;
  ros::Time last_received_;
  ros::Subscriber transforms_, static_transforms_;
};

}  // namespace acmp
