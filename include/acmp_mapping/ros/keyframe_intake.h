#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/input_matcher.h"
#include "acmp_mapping/ros/keyframe_gate.h"
#include "acmp_mapping/ros/node_options.h"

namespace acmp {

/// All that one keyframe is made of. The image is decoded and rectified later, by the worker.
struct KeyframeInput {
  int64_t stamp_ns = 0;
  std::shared_ptr<const EncodedImage> image;
  CalibrationPtr calibration;
  std::string camera_frame;  ///< the image's frame_id, else the camera_info's, else "camera_optical"
  std::string world_frame;   ///< ~world_frame, else the pose's frame_id, else "world"
  RigidTransform world_from_cam = RigidTransform::Identity();
  std::vector<Eigen::Vector3d> landmarks_in_world;
};

using IntakeEvent = std::variant<KeyframeInput, TimeJump, Drop>;

/// From samples of the input streams to keyframes: matches them, places the clouds in the world and chooses keyframes.
/// Knows messages but no topics. Not thread-safe.
class KeyframeIntake {
 public:
  /// @param fallback_depth stands in for the scene's depth while no landmarks tell; 0 = unknown
  KeyframeIntake(const NodeOptions& options, const KeyframeGateOptions& gate, double fallback_depth);

  void AddImage(std::shared_ptr<const EncodedImage> image);
  /// Throws InvalidInputError for a camera that cannot be used; images then wait for a better one.
  void AddCameraInfo(const sensor_msgs::CameraInfo& info);
  void AddPose(PoseSample pose) { matcher_.AddPose(std::move(pose)); }
  void AddCloud(SparseCloudPtr cloud) { matcher_.AddCloud(std::move(cloud)); }
  void set_clouds_expected(bool expected) { matcher_.set_clouds_expected(expected); }
  void set_gate(const KeyframeGateOptions& gate, double fallback_depth);

  /// What has happened since the last call, in order; see InputMatcher.
  std::vector<IntakeEvent> Take(double now_s) { return Convert(matcher_.Take(now_s)); }
  std::vector<IntakeEvent> TakeAll() { return Convert(matcher_.TakeAll()); }

  /// Forgets images, poses and clouds; the camera stays known.
  void Clear();

  size_t waiting_images() const { return matcher_.waiting_images(); }
  const std::optional<PoseGap>& last_gap() const { return matcher_.last_gap(); }
  uint64_t not_chosen() const { return not_chosen_; }  ///< posed images that the gate passed over

 private:
  std::vector<IntakeEvent> Convert(std::vector<MatchEvent> events);
  void Convert(const MatchedInput& match, std::vector<IntakeEvent>* events);
  std::vector<Eigen::Vector3d> PlaceCloud(const MatchedInput& match, const KeyframeInput& input,
                                          std::vector<IntakeEvent>* events) const;

  NodeOptions options_;
  InputMatcher matcher_;
  KeyframeGate gate_;
  double fallback_depth_;
  double scene_depth_ = 0;  ///< median of the landmarks that were last in front of the camera; 0 = none yet
  sensor_msgs::CameraInfo last_info_;
  CalibrationPtr calibration_;
  uint64_t not_chosen_ = 0;
};

}  // namespace acmp
