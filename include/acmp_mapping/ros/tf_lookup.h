#pragma once

#include <functional>
#include <string>

#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/ros/keyframe_intake.h"

namespace acmp {

/// Looks up in a buffer, which must outlive it: poses between the two transforms around their stamps. Never waits.
TransformSource TransformsOf(const tf2::BufferCore* buffer);

/// Transforms of /tf and /tf_static. Thread-safe.
class TfLookup {
 public:
  /// Listens in the node handle's callback queue.
  /// @param only_static of /tf_static alone, which costs nothing
  /// @param report told of transforms that cannot be used
  TfLookup(ros::NodeHandle nh, bool only_static, std::function<void(const std::string&)> report);

  TransformSource transforms() const { return TransformsOf(&buffer_); }

  /// Forgets all but static transforms: those of another run would be taken for newer ones.
  void Clear() { buffer_.clear(); }

 private:
  /// tf2's own listener throws in the middle of a message.
  void Receive(const tf2_msgs::TFMessage& message, bool is_static);

  const std::function<void(const std::string&)> report_;
  tf2::BufferCore buffer_;
  ros::Time last_received_;
  ros::Subscriber transforms_, static_transforms_;
};

}  // namespace acmp
