#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <ros/time.h>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

struct RecordingOptions {
  double rate_hz = 5;                  ///< images per second of bag time, 0.001..1000
  uint32_t start_time_s = 1600000000;  ///< stamp of image 0, > 0; fixed, so that the same input gives the same bytes
  int max_image_size = 0;              ///< px of the longer side; 0: as stored. Not with `compressed`
  bool compressed = false;             ///< the JPEG and PNG files as they are, as sensor_msgs/CompressedImage
  std::string world_frame = "world";
  std::string camera_frame = "camera_optical";
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const RecordingOptions& options);

/// Topics of a recorded bag; compressed images go to kImageTopic + "/compressed".
constexpr char kImageTopic[] = "/camera/image_raw";
constexpr char kMaskTopic[] = "/slam/mask";  ///< of images that have one (AddMasks): mono8, of the image's size
constexpr char kCameraInfoTopic[] = "/camera/camera_info";
constexpr char kPoseTopic[] = "/slam/pose";
constexpr char kSparsePointsTopic[] = "/slam/sparse_points";
constexpr char kTfTopic[] = "/tf";
constexpr char kOptimizedPathTopic[] = "/slam/optimized_path";  ///< of a simulated frontend

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

/// With `slam`, made of the same views, poses and points are the simulated frontend's, and the path that its loop
/// closure corrects comes before the image after it.
RecordingSummary RecordSynthetic(const std::vector<SyntheticView>& views, const RecordingOptions& options,
                                 const std::filesystem::path& bag_path, const SlamRun* slam = nullptr);

}  // namespace acmp
