#pragma once

#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// Messages of a recorded bag from the core's types. Headers are the caller's.
sensor_msgs::CompressedImage ToCompressedMessage(const std::string& file_bytes, const std_msgs::Header& header);

/// mono8, 0 = ignore.
sensor_msgs::Image ToMaskMessage(const Mask& mask, const std_msgs::Header& header);

/// K, P = [K 0], R = identity and the distortion under ROS's names: plumb_bob (5 coefficients; zero when there is
/// none), rational_polynomial (8) and equidistant (4).
sensor_msgs::CameraInfo ToCameraInfo(const PinholeCamera& camera, const LensDistortion& distortion,
                                     const std_msgs::Header& header);

/// The camera's pose T_world_cam, optical axes; header.frame_id names the world.
geometry_msgs::PoseStamped ToPoseStamped(const RigidTransform& cam_from_world, const std_msgs::Header& header);
tf2_msgs::TFMessage ToTf(const geometry_msgs::PoseStamped& world_from_cam, const std::string& camera_frame);

/// Fields x, y, z in float32.
sensor_msgs::PointCloud2 ToPointCloud2(const std::vector<Eigen::Vector3d>& points, const std_msgs::Header& header);

}  // namespace acmp
