#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/ros/image_decoder.h"
#include "acmp_mapping/ros/image_rectifier.h"

/// From ROS messages to the library's types; no master is needed. Throws InvalidInputError naming the value that cannot
/// be used.
namespace acmp {

/// The mask of an image. Throws InvalidInputError for an encoding other than mono8, or too few bytes.
CompanionSample ToMaskSample(const sensor_msgs::ImageConstPtr& message);
/// What it says of the image's pixels. Throws InvalidInputError where it has another size than the camera's images.
Mask DecodeMask(const EncodedImage& mask, const PinholeCamera& camera);

/// Depth from outside of an image, at any size. Throws InvalidInputError for an encoding other than 32FC1 (z in the
/// world's unit) and 16UC1 or mono16 (thousandths), for a side of 0 or more than 32767 px, and for too few bytes.
CompanionSample ToPriorDepthSample(const sensor_msgs::ImageConstPtr& message);
/// z at its own size; 0 where it is not positive and finite. Throws InvalidInputError where no pixel has a depth.
DepthMap DecodePriorDepth(const EncodedImage& depth);

/// Camera and distortion of the image as sent: binning and region of interest are applied, plumb_bob,
/// rational_polynomial and equidistant are known, also by other names; more coefficients than these have must be 0.
/// `rectified`: the image is undistorted already, P holds and D does not.
CameraCalibration ToCalibration(const sensor_msgs::CameraInfo& info, bool rectified);

/// x, y, z as float32 or float64; not-finite and exactly zero points are counted and left out.
SparseCloud ToSparseCloud(const sensor_msgs::PointCloud2& cloud);
/// `points` alone: what some frontends put in the channels does not keep to the message's rules.
SparseCloud ToSparseCloud(const sensor_msgs::PointCloud& cloud);

/// Not finite, or a quaternion off unit length by more than 1e-3, is refused.
RigidTransform ToTransform(const geometry_msgs::Pose& pose);
RigidTransform ToTransform(const geometry_msgs::Transform& transform);
PoseSample ToPoseSample(const geometry_msgs::PoseStamped& message);
PoseSample ToPoseSample(const geometry_msgs::PoseWithCovarianceStamped& message);
PoseSample ToPoseSample(const nav_msgs::Odometry& message);
PoseSample ToPoseSample(const geometry_msgs::TransformStamped& message);
PoseSample ToPoseSample(const std_msgs::Header& header, const std::string& child_frame,
                        const geometry_msgs::Pose& pose);

/// "/map" and "map" name one frame.
std::string StripLeadingSlash(const std::string& frame_id);

int64_t ToStampNs(const ros::Time& stamp);

}  // namespace acmp
