#include "acmp_mapping/ros/tf_lookup.h"

#include <tf2_eigen/tf2_eigen.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr double kCacheS = 30;  ///< images wait for their pose, so the newest transform may be far ahead of them

RigidTransform ToRigidTransform(const geometry_msgs::TransformStamped& message) {
  RigidTransform transform = RigidTransform::Identity();
  transform.matrix() = tf2::transformToEigen(message).matrix();
  return transform;
}

}  // namespace

TfLookup::TfLookup(const ros::NodeHandle& nh)
    : buffer_(ros::Duration(kCacheS)), listener_(buffer_, nh, false) {  // false: no thread of its own
  // Lookups do not wait, so it does not matter that nobody else fills the buffer meanwhile.
  buffer_.setUsingDedicatedThread(true);
}

std::variant<PoseSample, std::string> TfLookup::FindPose(const std::string& world, const std::string& child,
                                                         int64_t stamp_ns) {
  ros::Time stamp;
  stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
  try {
    return PoseSample{stamp_ns, world, ToRigidTransform(buffer_.lookupTransform(world, child, stamp)), child};
  } catch (const tf2::TransformException& error) {
    return Concat("tf has no \"", child, "\" in \"", world, "\" then: ", error.what());
  }
}

std::optional<RigidTransform> TfLookup::FindLatest(const std::string& target, const std::string& source) {
  try {
    return ToRigidTransform(buffer_.lookupTransform(target, source, ros::Time(0)));
  } catch (const tf2::TransformException&) {
    return std::nullopt;
  }
}

}  // namespace acmp
