#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <ros/time.h>
#include <Eigen/Geometry>

namespace acmp {

/// What a topic is used for by the mapper, by its message type.
enum class TopicRole { kOther, kImage, kCameraInfo, kPose, kTf, kSparsePoints };

struct BagTopic {
  std::string name;
  std::string type;
  TopicRole role = TopicRole::kOther;
  size_t messages = 0;
  ros::Time first;  ///< receive times
  ros::Time last;
  bool known_definition = true;  ///< false: recorded with another definition of the type
};

struct ImageRecord {
  ros::Time stamp;
  std::string frame;
  std::string encoding;  ///< "jpeg" and the like for compressed images
  bool compressed = false;
  uint32_t width = 0;    ///< px; 0 for compressed images
  uint32_t height = 0;   ///< px
  bool complete = true;  ///< as many bytes as size and encoding ask for
};

struct CameraInfoRecord {
  uint32_t width = 0;                     ///< px, of the image after region of interest and binning
  uint32_t height = 0;                    ///< px
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< px, of the full image
  bool resized = false;                   ///< has binning or a region of interest
  std::string distortion_model;
  size_t distortion_size = 0;
};

struct PoseRecord {
  ros::Time stamp;
  std::string frame;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Vector4d quaternion = {0, 0, 0, 1};  ///< x y z w, as recorded
};

struct CloudRecord {
  ros::Time stamp;
  std::string frame;
  std::string problem;  ///< why it could not be read; empty when it could
  size_t points = 0;
  size_t not_finite = 0;
  size_t all_zero = 0;
  std::vector<Eigen::Vector3f> sample;  ///< some of the remaining points, evenly spread
};

/// Topics the mapper would be given; an empty name is filled in from the bag by type.
struct TopicChoice {
  std::string image;
  std::string camera_info;
  std::string pose;  ///< empty in BagContents when the poses come from tf
  std::string sparse_points;
};

/// What the check needs to know of a bag, without pixels.
struct BagContents {
  std::vector<BagTopic> topics;
  TopicChoice chosen;
  std::vector<ImageRecord> images;
  std::vector<CameraInfoRecord> camera_infos;
  std::vector<PoseRecord> poses;
  std::vector<CloudRecord> clouds;
  std::string pose_from_tf;  ///< "world -> camera" when the poses come from tf, empty otherwise
};

/// Reads a bag. Throws InvalidInputError that says what is wrong when it is missing, not a bag, not indexed or
/// truncated, or when a chosen topic is not in it.
BagContents ReadBagContents(const std::filesystem::path& path, const TopicChoice& wanted);

}  // namespace acmp
