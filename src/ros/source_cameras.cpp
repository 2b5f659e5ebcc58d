#include "acmp_mapping/ros/source_cameras.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"

namespace acmp {
namespace {

/// That are kept: a focus that changes with each image, for half a minute.
constexpr size_t kCalibrations = 1000;

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

/// Whether only the headers' stamps and numbers differ.
bool SaysTheSame(const sensor_msgs::CameraInfo& a, sensor_msgs::CameraInfo b) {
  b.header.stamp = a.header.stamp;
  b.header.seq = a.header.seq;
  return a == b;
}

}  // namespace

CalibrationPtr CheckedCalibration(const sensor_msgs::CameraInfo& info, const NodeOptions& options) {
  auto calibration =
      std::make_shared<const CameraCalibration>(ToCalibration(info, options.rectified, options.field_of_view));
  const PinholeCamera& camera = calibration->camera;
  CheckMemory(Concat("an image of ", camera.width, "x", camera.height, " pixels, as camera_info has it,"),
              static_cast<uint64_t>(camera.width) * static_cast<uint64_t>(camera.height), kImagePixelBytes,
              static_cast<size_t>(1e9 * options.memory_limit_gb));
  return calibration;
}

void CalibrationHistory::Add(const sensor_msgs::CameraInfo& info, const NodeOptions& options) {
  if (last_.calibration && SaysTheSame(info, last_.info)) return;
  last_ = {};
  last_.calibration = CheckedCalibration(info, options);
  last_.info = info;
  const int64_t stamp_ns = ToStampNs(info.header.stamp);
  changes_.erase(changes_.upper_bound(stamp_ns), changes_.end());  // time has gone back
  changes_.insert_or_assign(stamp_ns, last_);
  if (changes_.size() > kCalibrations) changes_.erase(changes_.begin());
}

const CalibrationHistory::Entry& CalibrationHistory::At(int64_t stamp_ns) const {
  const auto later = changes_.upper_bound(stamp_ns);
  return later == changes_.begin() ? last_ : std::prev(later)->second;
}

SourceCameras::SourceCameras(const NodeOptions& options, TransformSource transforms)
    : options_(options),
      transforms_(std::move(transforms)),
      cameras_(static_cast<size_t>(options.matcher.source_cameras)) {
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
  cameras_.at(camera).calibrations.Add(info, options_);
}

std::variant<SourceImage, RejectedInput> SourceCameras::Place(size_t camera, std::shared_ptr<const EncodedImage> image,
                                                              const sensor_msgs::CameraInfo& info,
                                                              const std::string& camera_frame) {
  const Camera& of = cameras_.at(camera);
  const int64_t stamp_ns = ToStampNs(image->header().stamp);
  const std::string at = Concat("image ", FormatStamp(stamp_ns), " of source camera ", camera + 1, " is not used: ");
  if (!of.calibrations.last().calibration) {
    return RejectedInput{"no_source_camera_info", at + "no usable camera_info of it has come"};
  }
  const CalibrationPtr calibration = of.calibrations.At(stamp_ns).calibration;
  std::string frame = StripLeadingSlash(image->header().frame_id);
  if (frame.empty()) frame = calibration->frame_id;
  const FoundPlace place = FindPlace(camera, stamp_ns, info, camera_frame, frame);
  if (!place.source_from_cam) return RejectedInput{"source_camera_unplaced", at + place.who};
  if (!(place.source_from_cam->translation().norm() > 0)) {
    return RejectedInput{"source_camera_unplaced",
                         Concat(at, "it is where the camera is, by ", place.who,
                                ", and without a baseline there is no depth: set ~T_cam_source")};
  }
  Tell(camera, place);
  return SourceImage{std::move(image), calibration, *place.source_from_cam};
}

SourceCameras::FoundPlace SourceCameras::FindPlace(size_t index, int64_t stamp_ns, const sensor_msgs::CameraInfo& info,
                                                   const std::string& camera_frame,
                                                   const std::string& source_frame) const {
  if (!options_.cam_from_sources.empty()) return {options_.cam_from_sources.at(index).inverse(), "~T_cam_source"};
  FoundPlace by_infos = {
      SourceFromCameraInfos(info, cameras_[index].calibrations.At(stamp_ns).info, options_.rectified),
      "P of the camera_infos"};
  const bool has_frames = !source_frame.empty() && !camera_frame.empty();
  FoundPlace by_tf = {std::nullopt, Concat("tf from \"", source_frame, "\" to \"", camera_frame, "\"")};
  if (has_frames) {
    if (transforms_.find_pose) {
      auto found = transforms_.find_pose(source_frame, camera_frame, stamp_ns);
      if (const auto* pose = std::get_if<PoseSample>(&found)) by_tf.source_from_cam = pose->received;
    }
    if (!by_tf.source_from_cam && transforms_.find_latest) {
      by_tf.source_from_cam = transforms_.find_latest(source_frame, camera_frame);
    }
  }
  if (by_infos.source_from_cam) {
    // Stereo drivers name both images after the left camera: then tf says nothing.
    if (!by_tf.source_from_cam || !(by_tf.source_from_cam->translation().norm() > 0)) return by_infos;
    constexpr double kSamePlace = 0.1;  // of the baseline: drawings are not exact
    const Eigen::Vector3d of_infos = by_infos.source_from_cam->inverse().translation();
    const Eigen::Vector3d of_tf = by_tf.source_from_cam->inverse().translation();
    if ((of_infos - of_tf).norm() <= kSamePlace * of_infos.norm()) return by_infos;
    // A baseline of another length is that of another pair. The same one elsewhere: the frames' axes are no camera's.
    const bool is_of_pair = std::abs(of_infos.norm() - of_tf.norm()) <= kSamePlace * of_infos.norm();
    FoundPlace taken = is_of_pair ? by_infos : by_tf;
    const FoundPlace& other = is_of_pair ? by_tf : by_infos;
    taken.is_doubtful = true;
    taken.who += Concat("; but ", other.who, " has another place, (", (is_of_pair ? of_tf : of_infos).transpose(),
                        "): ~T_cam_source decides");
    return taken;
  }
  if (by_tf.source_from_cam) return by_tf;
  const std::string missing = "P of the camera_infos has no baseline, and ";
  if (!has_frames) {
    return {std::nullopt,
            missing + "the images have no frame_id by which tf could tell where it is: set ~T_cam_source"};
  }
  return {std::nullopt, Concat(missing, "tf has no transform from \"", source_frame, "\" to \"", camera_frame,
                               "\": set ~T_cam_source, or publish it")};
}

void SourceCameras::Tell(size_t index, const FoundPlace& place) {
  Camera& of = cameras_[index];
  const RigidTransform cam_from_source = place.source_from_cam->inverse();
  const auto tell = [&](bool is_warning, const std::string& verb) {
    const std::string text = Concat("source camera ", index + 1, verb, " (", cam_from_source.translation().transpose(),
                                    ") of the camera, by ", place.who);
    if (!notice_) notice_ = Notice{};
    notice_->warning = notice_->warning || is_warning;
    notice_->text += (notice_->text.empty() ? "" : "; ") + text;
  };
  if (!of.told) {
    of.told = cam_from_source;
    return tell(place.is_doubtful, " is at");
  }
  constexpr double kElsewhere = 0.01;  // of the baseline, and rad
  const RigidTransform moved = of.told->inverse() * cam_from_source;
  const bool is_there = moved.translation().norm() <= kElsewhere * of.told->translation().norm() &&
                        Eigen::AngleAxisd(moved.linear()).angle() <= kElsewhere;
  if (is_there || of.told_again) return;
  of.told_again = true;
  tell(place.is_doubtful, " has moved, is looked up for each image, and is now at");
}

std::optional<Notice> SourceCameras::TakeNotice() { return std::exchange(notice_, {}); }

}  // namespace acmp
