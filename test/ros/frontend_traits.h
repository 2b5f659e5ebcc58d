#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp::test {

/// What a frontend does to a stamp on its way from the image to a message.
enum class StampRounding {
  kNone,
  kDouble,        ///< ros::Time -> double seconds -> ros::Time: up to 119 ns off
  kMicroseconds,  ///< cut by PCL's header
  kSendingTime,   ///< replaced by the time of sending
};

enum class PoseMessage { kPoseStamped, kOdometry, kTf };

enum class CloudMessage {
  kXyz,              ///< sensor_msgs/PointCloud2 of three floats
  kPclXyz,           ///< the same, PCL's 16-byte points
  kPclXyzRgb,        ///< the same, PCL's 32-byte points
  kChannelPerPoint,  ///< sensor_msgs/PointCloud with a channel for each point, as VINS has it
};

struct StaticTransform {
  std::string parent, child;
  RigidTransform parent_from_child;
};

/// What one SLAM frontend publishes. The sources of these facts are named in config/frontends/*.yaml.
struct FrontendTraits {
  std::string name;

  std::string image_topic, camera_info_topic;  ///< empty camera_info_topic: it publishes none
  std::string image_frame;
  std::string output_frame;  ///< that the mapper's images must have; empty: the image's

  PoseMessage pose_message = PoseMessage::kPoseStamped;
  std::string pose_topic, world_frame, child_frame;
  /// Maps the optical frame to the frame whose pose is published.
  RigidTransform child_from_cam = RigidTransform::Identity();
  /// Maps the axes of the synthetic scene to the frontend's world; no rounding: a permutation of axes.
  Eigen::Matrix3d world_from_scene = Eigen::Matrix3d::Identity();
  StampRounding pose_stamp = StampRounding::kNone;
  bool float_poses = false;  ///< it computes with float numbers
  size_t pose_delay = 0;     ///< so many later images come first
  int poses_per_image = 1;   ///< more: poses between the images, too, 5 ms apart

  CloudMessage cloud_message = CloudMessage::kXyz;
  std::string cloud_topic, cloud_frame;
  StampRounding cloud_stamp = StampRounding::kNone;
  bool whole_map = false;    ///< else what the image observes
  bool zero_points = false;  ///< (0, 0, 0) among the points

  std::string path_topic, path_frame;  ///< nav_msgs/Path of its poses after loop closure, stamped as they; empty: none

  std::string extrinsic_topic;  ///< nav_msgs/Odometry with child_from_cam; empty: none
  std::vector<StaticTransform> static_transforms;

  /// Whether the mapper gets the numbers of the camera's pose as they are, so that nothing at all may differ.
  bool SendsSameNumbers() const;
};

/// An IMU's frame in which the camera is turned about two axes and off the centre; short decimals, so that launch files
/// can have the same numbers.
RigidTransform ImuFromCamera();

const std::vector<FrontendTraits>& AllFrontends();

/// Throws InvalidInputError for an unknown name.
const FrontendTraits& FindFrontend(const std::string& name);

}  // namespace acmp::test
