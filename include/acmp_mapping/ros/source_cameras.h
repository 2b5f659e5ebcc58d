#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
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

/// Something the user should read.
struct Notice {
  bool warning = false;
  std::string text;
};

/// Where poses and T_body_cam are looked up. Must not wait. May be empty where the options do not ask for it.
struct TransformSource {
  /// Pose of `child` in `world` at a stamp, or why there is none.
  std::function<std::variant<PoseSample, std::string>(const std::string& world, const std::string& child,
                                                      int64_t stamp_ns)>
      find_pose;
  TransformLookup find_latest;
};

/// What `info` says of the image as sent. Throws InvalidInputError as ToCalibration does, and where an image of that
/// size would take more than memory_limit.
CalibrationPtr CheckedCalibration(const sensor_msgs::CameraInfo& info, const NodeOptions& options);

/// What a camera's camera_infos said when: a zoom, or a focus, changes with the images. Not thread-safe.
class CalibrationHistory {
 public:
  struct Entry {
    sensor_msgs::CameraInfo info;
    CalibrationPtr calibration;  ///< null: none has come, or the last one cannot be used
  };

  /// Throws as CheckedCalibration; then there is none until the next that can be used.
  void Add(const sensor_msgs::CameraInfo& info, const NodeOptions& options);
  const Entry& last() const { return last_; }
  /// Of the last camera_info up to this stamp; the last one where none is as old.
  const Entry& At(int64_t stamp_ns) const;

 private:
  Entry last_;
  std::map<int64_t, Entry> changes_;  ///< by stamp
};

/// An image of a source camera, taken with a keyframe's.
struct SourceImage {
  std::shared_ptr<const EncodedImage> image;
  CalibrationPtr calibration;
  RigidTransform source_from_cam = RigidTransform::Identity();  ///< from the camera's optical frame; unit of the poses
};

/// The cameras that are fixed to the mapper's and bring source images alone. Where one is comes from the first of these
/// that tells: ~T_cam_source; P of both camera_infos, as stereo calibration writes it (with R, where images are not
/// rectified), unless it is the same for both, or tf has a baseline of another length, as they are no pair then; tf
/// between the frames of the images. All of these are looked up for each image, at its stamp. Not thread-safe.
class SourceCameras {
 public:
  /// Reads ~source_calibration_file. Throws InvalidInputError.
  /// @param transforms tf; may be empty
  SourceCameras(const NodeOptions& options, TransformSource transforms);

  size_t size() const { return cameras_.size(); }

  /// @param camera from 0. Throws InvalidInputError for one that cannot be used; images then go without it.
  void AddCameraInfo(size_t camera, const sensor_msgs::CameraInfo& info);

  /// The image with what is known of its camera, or why it cannot be used.
  /// @param info of the mapper's camera
  /// @param camera_frame its frame in tf
  std::variant<SourceImage, RejectedInput> Place(size_t camera, std::shared_ptr<const EncodedImage> image,
                                                 const sensor_msgs::CameraInfo& info, const std::string& camera_frame);

  /// Where a camera is and who says so, once; and once that it is elsewhere.
  std::optional<Notice> TakeNotice();

 private:
  struct Camera {
    CalibrationHistory calibrations;
    std::optional<RigidTransform> told;  ///< where it is, as of the first notice
    bool told_again = false;
  };
  struct FoundPlace {
    std::optional<RigidTransform> source_from_cam;  ///< none: not known
    std::string who;                                ///< says so, or what is missing
    bool is_doubtful = false;                       ///< P and tf differ
  };
  FoundPlace FindPlace(size_t index, int64_t stamp_ns, const sensor_msgs::CameraInfo& info,
                       const std::string& camera_frame, const std::string& source_frame) const;
  void Tell(size_t index, const FoundPlace& place);

  NodeOptions options_;
  TransformSource transforms_;
  std::vector<Camera> cameras_;
  std::optional<Notice> notice_;
};

}  // namespace acmp
