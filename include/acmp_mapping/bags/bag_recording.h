#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

constexpr uint32_t kStartTime_s = 1600000000;  ///< stamp of image 0: the same input gives the same bytes
constexpr char kWorldFrame[] = "world";
constexpr char kCameraFrame[] = "camera_optical";

struct RecordingOptions {
  double rate_hz = 5;      ///< images per second of bag time, 0.001..1000
  int max_image_size = 0;  ///< px of the longer side; 0: as stored
  bool labels = false;     ///< of a synthetic scene: what each pixel shows
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const RecordingOptions& options);

/// Topics of a recorded bag.
constexpr char kImageTopic[] = "/camera/image_raw";
constexpr char kMaskTopic[] = "/slam/mask";     ///< of images that have one (AddMasks): mono8, of the image's size
constexpr char kLabelTopic[] = "/slam/labels";  ///< mono8: SyntheticLabel
constexpr char kCameraInfoTopic[] = "/camera/camera_info";
constexpr char kRightImageTopic[] = "/camera_right/image_raw";         ///< of views that have a right image
constexpr char kRightCameraInfoTopic[] = "/camera_right/camera_info";  ///< its P has the baseline
constexpr char kRightCameraFrame[] = "camera_right_optical";           ///< not in tf
constexpr char kPoseTopic[] = "/slam/pose";
constexpr char kSparsePointsTopic[] = "/slam/sparse_points";
constexpr char kTfTopic[] = "/tf";

struct RecordingSummary {
  size_t images = 0;
  size_t masks = 0;
  size_t landmarks = 0;  ///< observations in all
  double duration_s = 0;
};

/// Stamp of an image: start + index / rate, to the nanosecond.
ros::Time StampOf(int index, const RecordingOptions& options);

/// Writes the chosen images of a scene. Stamps follow the index in the scene, so leaving images out leaves gaps.
RecordingSummary RecordScene(const Scene& scene, const std::vector<int>& indices, const RecordingOptions& options,
                             const std::filesystem::path& bag_path);

/// With true poses and points.
RecordingSummary RecordSynthetic(const std::vector<SyntheticView>& views, const RecordingOptions& options,
                                 const std::filesystem::path& bag_path);

// Messages of a recorded bag from the core's types. Headers are the caller's.

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
