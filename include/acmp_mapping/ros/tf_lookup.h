#pragma once

#include <optional>
#include <string>
#include <variant>

#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// Transforms of /tf and /tf_static. Never waits. Thread-safe.
class TfLookup {
 public:
  /// Listens in the node handle's callback queue.
  explicit TfLookup(const ros::NodeHandle& nh);

  /// Pose of `child` in `world` at a stamp, between the two transforms around it; or why there is none (yet).
  std::variant<PoseSample, std::string> FindPose(const std::string& world, const std::string& child, int64_t stamp_ns);

  /// The newest pose of `source` in `target`; none while they are not connected.
  std::optional<RigidTransform> FindLatest(const std::string& target, const std::string& source);

  /// Forgets all but static transforms: those of another run would be taken for newer ones.
  void Clear() { buffer_.clear(); }

 private:
  tf2_ros::Buffer buffer_;
  tf2_ros::TransformListener listener_;
};

}  // namespace acmp
