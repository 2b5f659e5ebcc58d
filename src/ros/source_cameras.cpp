#include "acmp_mapping/ros/source_cameras.h"

#include <algorithm>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"

namespace acmp {
namespace {

/// Decoded twice, undistorted, and where each pixel comes from in two forms.
constexpr uint64_t kImagePixelBytes = 24;

/// The rectified camera's centre in the frame that both of a pair share, as P has it: x_cam = x_shared + this.
Eigen::Vector3d ShiftOf(const sensor_msgs::CameraInfo& info) {
  return {info.P[3] / info.P[0], info.P[7] / info.P[5], 0};
}

/// From the image's camera to the rectified one; none where R says nothing.
std::optional<Eigen::Matrix3d> RectificationOf(const sensor_msgs::CameraInfo& info) {
  const Eigen::Matrix3d rotation = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(info.R.data());
  const bool is_rotation = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3;
  return is_rotation ? std::make_optional(rotation) : std::nullopt;
}

/// What P of both cameras says; none where it says no baseline.
std::optional<RigidTransform> SourceFromCameraInfos(const sensor_msgs::CameraInfo& camera,
                                                    const sensor_msgs::CameraInfo& source, bool rectified) {
  if (!(camera.P[0] > 0 && camera.P[5] > 0 && source.P[0] > 0 && source.P[5] > 0)) return std::nullopt;
  RigidTransform source_from_cam = RigidTransform::Identity();
  source_from_cam.translation() = ShiftOf(source) - ShiftOf(camera);
  if (!(source_from_cam.translation().norm() > 0) || !source_from_cam.translation().allFinite()) return std::nullopt;
  if (rectified) return source_from_cam;
  const auto of_camera = RectificationOf(camera), of_source = RectificationOf(source);
  if (!of_camera || !of_source) return std::nullopt;
  RigidTransform to_rectified = RigidTransform::Identity(), from_rectified = RigidTransform::Identity();
  to_rectified.linear() = *of_camera;
  from_rectified.linear() = of_source->transpose();
  return from_rectified * source_from_cam * to_rectified;
}

}  // namespace

bool SaysTheSame(const sensor_msgs::CameraInfo& a, sensor_msgs::CameraInfo b) {
  b.header.stamp = a.header.stamp;
  b.header.seq = a.header.seq;
  return a == b;
}

CalibrationPtr CheckedCalibration(const sensor_msgs::CameraInfo& info, const NodeOptions& options) {
  auto calibration =
      std::make_shared<const CameraCalibration>(ToCalibration(info, options.rectified, options.field_of_view));
  const PinholeCamera& camera = calibration->camera;
  CheckMemory(Concat("an image of ", camera.width, "x", camera.height, " pixels, as camera_info has it,"),
              static_cast<uint64_t>(camera.width) * static_cast<uint64_t>(camera.height), kImagePixelBytes,
              static_cast<size_t>(1e9 * options.memory_limit_gb));
  return calibration;
}

SourceCameras::SourceCameras(const NodeOptions& options, TransformLookup lookup)
    : options_(options), lookup_(std::move(lookup)), cameras_(static_cast<size_t>(options.matcher.source_cameras)) {
  std::vector<std::string> files;
  std::istringstream names(options_.source_calibration_file);
  for (std::string name; std::getline(names, name, ',');) files.push_back(name);
  if (!files.empty() && files.size() != cameras_.size()) {
    throw InvalidInputError(Concat("parameter ~source_calibration_file = \"", options_.source_calibration_file,
                                   "\": ", files.size(),
                                   " file(s), must be one for each of ~source_cameras = ", cameras_.size()));
  }
  for (size_t i = 0; i < files.size(); ++i) AddCameraInfo(i, ReadCalibrationFile(files[i], options_.rectified));
}

void SourceCameras::AddCameraInfo(size_t camera, const sensor_msgs::CameraInfo& info) {
  Camera& of = cameras_.at(camera);
  if (of.calibration && SaysTheSame(info, of.info)) return;
  of = {};
  of.calibration = CheckedCalibration(info, options_);
  of.info = info;
}

std::variant<SourceImage, RejectedInput> SourceCameras::Place(size_t camera, std::shared_ptr<const EncodedImage> image,
                                                              const sensor_msgs::CameraInfo& info,
                                                              const std::string& camera_frame) {
  Camera& of = cameras_.at(camera);
  const std::string at = Concat("image ", FormatStamp(ToStampNs(image->header().stamp)), " of source camera ",
                                camera + 1, " is not used: ");
  if (!of.calibration) return RejectedInput{"no_source_camera_info", at + "no usable camera_info of it has come"};
  if (!of.source_from_cam) {
    std::string frame = StripLeadingSlash(image->header().frame_id);
    if (frame.empty()) frame = of.calibration->frame_id;
    const std::string who = FindPlace(camera, info, camera_frame, frame);
    if (!of.source_from_cam) return RejectedInput{"source_camera_unplaced", at + who};
    const RigidTransform cam_from_source = of.source_from_cam->inverse();
    notice_ += Concat(notice_.empty() ? "" : "; ", "source camera ", camera + 1, " is at (",
                      cam_from_source.translation().transpose(), ") of the camera, by ", who);
  }
  if (!(of.source_from_cam->translation().norm() > 0)) {
    return RejectedInput{"source_camera_unplaced",
                         at + "it is where the camera is, and without a baseline there is no depth: set ~T_cam_source"};
  }
  return SourceImage{std::move(image), of.calibration, *of.source_from_cam};
}

std::string SourceCameras::FindPlace(size_t index, const sensor_msgs::CameraInfo& info, const std::string& camera_frame,
                                     const std::string& source_frame) {
  Camera& of = cameras_[index];
  if (!options_.cam_from_sources.empty()) {
    of.source_from_cam = options_.cam_from_sources.at(index).inverse();
    return "~T_cam_source";
  }
  of.source_from_cam = SourceFromCameraInfos(info, of.info, options_.rectified);
  if (of.source_from_cam) return "P of the camera_infos";
  const std::string missing = "P of the camera_infos has no baseline, and ";
  if (source_frame.empty() || camera_frame.empty()) {
    return missing + "the images have no frame_id by which tf could tell where it is: set ~T_cam_source";
  }
  if (lookup_) of.source_from_cam = lookup_(source_frame, camera_frame);
  if (of.source_from_cam) return Concat("tf from \"", source_frame, "\" to \"", camera_frame, "\"");
  return Concat(missing, "tf has no transform from \"", source_frame, "\" to \"", camera_frame,
                "\": set ~T_cam_source, or publish it");
}

std::optional<std::string> SourceCameras::TakeNotice() {
  if (notice_.empty()) return std::nullopt;
  return std::exchange(notice_, {});
}

}  // namespace acmp
