#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <sensor_msgs/CameraInfo.h>

#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// Whether only the headers' stamps and numbers differ.
bool SaysTheSame(const sensor_msgs::CameraInfo& a, sensor_msgs::CameraInfo b);

/// What `info` says of the image as sent. Throws InvalidInputError as ToCalibration does, and where an image of that
/// size would take more than memory_limit.
CalibrationPtr CheckedCalibration(const sensor_msgs::CameraInfo& info, const NodeOptions& options);

/// An image of a source camera, taken with a keyframe's.
struct SourceImage {
  std::shared_ptr<const EncodedImage> image;
  CalibrationPtr calibration;
  RigidTransform source_from_cam = RigidTransform::Identity();  ///< from the camera's optical frame; unit of the poses
};

/// The cameras that are fixed to the mapper's and bring source images alone. Where one is comes from the first of these
/// that tells: ~T_cam_source; P of both camera_infos, as stereo calibration writes it (with R, where images are not
/// rectified), unless it is the same for both; tf between the frames of the images. Then it stays. Not thread-safe.
class SourceCameras {
 public:
  /// Reads ~source_calibration_file. Throws InvalidInputError.
  /// @param lookup of tf; may be empty
  SourceCameras(const NodeOptions& options, TransformLookup lookup);

  size_t size() const { return cameras_.size(); }

  /// @param camera from 0. Throws InvalidInputError for one that cannot be used; images then go without it.
  void AddCameraInfo(size_t camera, const sensor_msgs::CameraInfo& info);

  /// The image with what is known of its camera, or why it cannot be used.
  /// @param info of the mapper's camera
  /// @param camera_frame its frame in tf
  std::variant<SourceImage, RejectedInput> Place(size_t camera, std::shared_ptr<const EncodedImage> image,
                                                 const sensor_msgs::CameraInfo& info, const std::string& camera_frame);

  /// Where a camera is and who says so, once.
  std::optional<std::string> TakeNotice();

 private:
  struct Camera {
    sensor_msgs::CameraInfo info;
    CalibrationPtr calibration;                     ///< null: not known
    std::optional<RigidTransform> source_from_cam;  ///< none: not known
  };
  /// Sets it where something tells. Returns what does, or what is missing.
  std::string FindPlace(size_t index, const sensor_msgs::CameraInfo& info, const std::string& camera_frame,
                        const std::string& source_frame);

  NodeOptions options_;
  TransformLookup lookup_;
  std::vector<Camera> cameras_;
  std::string notice_;
};

}  // namespace acmp
