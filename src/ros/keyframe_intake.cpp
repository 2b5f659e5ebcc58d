#include "acmp_mapping/ros/keyframe_intake.h"

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

// tf and rviz refuse empty names.
constexpr char kNamelessCamera[] = "camera_optical";
constexpr char kNamelessWorld[] = "world";

/// Median depth of the points in front of the camera; 0 when there are none. A sample of a whole map is enough.
double MedianDepth(const std::vector<Eigen::Vector3d>& points_in_world, const RigidTransform& world_from_cam) {
  constexpr size_t kSample = 2000;
  const RigidTransform cam_from_world = world_from_cam.inverse();
  const size_t step = 1 + points_in_world.size() / kSample;
  std::vector<double> depths;
  for (size_t i = 0; i < points_in_world.size(); i += step) {
    const double depth = (cam_from_world * points_in_world[i]).z();
    if (depth > 0) depths.push_back(depth);
  }
  if (depths.empty()) return 0;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

std::vector<Eigen::Vector3d> Moved(const RigidTransform& world_from_cloud, const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> moved(points.size());
  std::transform(points.begin(), points.end(), moved.begin(),
                 [&](const Eigen::Vector3d& point) { return world_from_cloud * point; });
  return moved;
}

}  // namespace

KeyframeIntake::KeyframeIntake(const NodeOptions& options, const KeyframeGateOptions& gate, double fallback_depth)
    : options_(options), matcher_(options.matcher), fallback_depth_(fallback_depth) {
  gate_.set_options(gate);
}

void KeyframeIntake::AddImage(std::shared_ptr<const EncodedImage> image) {
  const int64_t stamp_ns = ToStampNs(image->header().stamp);
  matcher_.AddImage({stamp_ns, std::move(image)});
}

void KeyframeIntake::AddCameraInfo(const sensor_msgs::CameraInfo& info) {
  if (calibration_ && info.K == last_info_.K && info.P == last_info_.P && info.D == last_info_.D &&
      info.distortion_model == last_info_.distortion_model && info.width == last_info_.width &&
      info.height == last_info_.height && info.binning_x == last_info_.binning_x &&
      info.binning_y == last_info_.binning_y && info.roi == last_info_.roi &&
      info.header.frame_id == last_info_.header.frame_id) {
    return;
  }
  try {
    calibration_ = std::make_shared<const CameraCalibration>(ToCalibration(info, options_.rectified));
  } catch (const InvalidInputError&) {
    calibration_.reset();
    matcher_.set_calibrated(false);
    throw;
  }
  last_info_ = info;
  matcher_.set_calibrated(true);
}

void KeyframeIntake::set_gate(const KeyframeGateOptions& gate, double fallback_depth) {
  gate_.set_options(gate);
  fallback_depth_ = fallback_depth;
}

void KeyframeIntake::Clear() {
  matcher_.Clear("reset");
  gate_.Reset();
  scene_depth_ = 0;
}

std::vector<IntakeEvent> KeyframeIntake::Convert(std::vector<MatchEvent> matched) {
  std::vector<IntakeEvent> events;
  for (MatchEvent& event : matched) {
    if (auto* match = std::get_if<MatchedInput>(&event)) {
      Convert(*match, &events);
    } else if (auto* drop = std::get_if<Drop>(&event)) {
      events.emplace_back(std::move(*drop));
    } else {
      gate_.Reset();
      scene_depth_ = 0;
      events.emplace_back(std::get<TimeJump>(event));
    }
  }
  return events;
}

void KeyframeIntake::Convert(const MatchedInput& match, std::vector<IntakeEvent>* events) {
  KeyframeInput input;
  input.stamp_ns = match.image.stamp_ns;
  input.image = match.image.image;
  input.calibration = calibration_;
  input.camera_frame = StripLeadingSlash(match.image.image->header().frame_id);
  if (input.camera_frame.empty()) input.camera_frame = calibration_->frame_id;
  if (input.camera_frame.empty()) input.camera_frame = kNamelessCamera;
  input.world_frame = options_.world_frame.empty() ? match.pose.world_frame : options_.world_frame;
  if (input.world_frame.empty()) input.world_frame = kNamelessWorld;
  input.world_from_cam = match.pose.world_from_cam;
  input.landmarks_in_world = PlaceCloud(match, input, events);

  if (options_.keyframe_mode == KeyframeMode::kGate) {
    const double depth = MedianDepth(input.landmarks_in_world, input.world_from_cam);
    if (depth > 0) scene_depth_ = depth;
    if (!gate_.Accept(input.stamp_ns, input.world_from_cam, scene_depth_ > 0 ? scene_depth_ : fallback_depth_)) {
      ++not_chosen_;
      return;
    }
  }
  events->emplace_back(std::move(input));
}

std::vector<Eigen::Vector3d> KeyframeIntake::PlaceCloud(const MatchedInput& match, const KeyframeInput& input,
                                                        std::vector<IntakeEvent>* events) const {
  if (!match.cloud) return {};
  const SparseCloud& cloud = *match.cloud;
  const std::string at = Concat("sparse cloud ", FormatStamp(cloud.stamp_ns));
  if (cloud.points.empty()) {
    events->emplace_back(Drop{"sparse_empty", Concat(at, ": 0 usable points (", cloud.not_finite, " not finite, ",
                                                     cloud.zero, " exactly zero)")});
    return {};
  }
  SparseFrame frame = options_.sparse_frame;
  if (frame == SparseFrame::kAuto) {
    const bool in_world =
        cloud.frame_id.empty() || cloud.frame_id == match.pose.world_frame || cloud.frame_id == input.world_frame;
    const bool in_camera = cloud.frame_id == input.camera_frame || cloud.frame_id == calibration_->frame_id;
    if (!in_world && !in_camera) {
      events->emplace_back(
          Drop{"sparse_frame_unknown",
               Concat(at, ": its frame \"", cloud.frame_id, "\" is neither the world \"", input.world_frame,
                      "\" nor the camera \"", input.camera_frame, "\"; set ~sparse_frame to world or camera")});
      return {};
    }
    frame = in_world ? SparseFrame::kWorld : SparseFrame::kCamera;
  }
  if (frame == SparseFrame::kWorld) return cloud.points;
  if (!match.cloud_pose) {
    events->emplace_back(Drop{"sparse_without_pose", Concat(at,
                                                            " is in the camera's frame, and there is no pose at its "
                                                            "stamp")});
    return {};
  }
  return Moved(match.cloud_pose->world_from_cam, cloud.points);
}

}  // namespace acmp
