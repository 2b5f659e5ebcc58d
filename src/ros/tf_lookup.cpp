#include "acmp_mapping/ros/tf_lookup.h"

#include <exception>
#include <limits>
#include <utility>

#include <tf2_eigen/tf2_eigen.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

constexpr uint32_t kTfQueue = 100;
constexpr double kCacheS = 30;  ///< images wait for their pose, so the newest transform may be far ahead of them

}  // namespace

TfLookup::TfLookup(std::function<void(const std::string&)> report)
    : report_(std::move(report)), buffer_(ros::Duration(kCacheS)) {}

void TfLookup::Listen(const ros::NodeHandle& nh) {
  const auto subscribe = [&](const char* topic, bool is_static) {
    return SubscribeChecked<tf2_msgs::TFMessage>(nh, topic, kTfQueue, [this, is_static](const auto& message) {
      Receive(*message, is_static, ros::Time::now());
    });
  };
  transforms_ = subscribe(names::kTf, false);
  static_transforms_ = subscribe(names::kTfStatic, true);
}

void TfLookup::Receive(const tf2_msgs::TFMessage& message, bool is_static, const ros::Time& now) {
  if (now < last_received_) Clear();  // a simulated clock went back
  last_received_ = now;
  // The buffer adds its length to stamps, which throws for the last ones that a message can hold.
  const uint32_t last_sec = std::numeric_limits<uint32_t>::max() - static_cast<uint32_t>(kCacheS) - 1;
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    try {
      CheckRange("stamp [s]", transform.header.stamp.sec, 0u, last_sec);
      buffer_.setTransform(transform, "", is_static);
    } catch (const std::exception& error) {
      report_(Concat("tf, \"", transform.child_frame_id, "\" in \"", transform.header.frame_id, "\": ", error.what()));
    }
  }
}

TransformSource TfLookup::transforms() const {
  const tf2::BufferCore* const buffer = &buffer_;
  TransformSource source;
  source.find_pose = [buffer](const std::string& world, const std::string& child,
                              int64_t stamp_ns) -> std::variant<PoseSample, std::string> {
    try {
      ros::Time stamp;
      stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
      return PoseSample{stamp_ns, world,
                        RigidTransform(tf2::transformToEigen(buffer->lookupTransform(world, child, stamp))), child};
    } catch (const std::exception& error) {  // of tf2, or of ros::Time for stamps at the end of its range
      return Concat("tf has no \"", child, "\" in \"", world, "\" then: ", error.what());
    }
  };
  source.find_latest = [buffer](const std::string& target, const std::string& frame) -> std::optional<RigidTransform> {
    try {
      return RigidTransform(tf2::transformToEigen(buffer->lookupTransform(target, frame, ros::Time(0))));
    } catch (const std::exception&) {
      return std::nullopt;
    }
  };
  return source;
}

}  // namespace acmp
