#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <acmp_mapping/Keyframe.h>

#include "acmp_mapping/intake/convention_check.h"
#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/intake/world_tracker.h"
#include "acmp_mapping/map/loop_correction.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/source_cameras.h"

namespace acmp {

/// Where and when a capture was taken, and what its frames are called.
struct CaptureOrigin {
  int64_t stamp_ns = 0;      ///< of the image
  double arrival_s = 0;      ///< steady clock, of the image
  std::string camera_frame;  ///< the image's frame_id, else the camera_info's, else "camera_optical"
  std::string world_frame;   ///< ~world_frame, else the pose's frame_id, else "world"
  RigidTransform world_from_cam = RigidTransform::Identity();
  PathConvention path;     ///< of optimized_path
  std::string path_frame;  ///< frame_id of its poses; empty: any
  // When it is made into frames:
  uint64_t run = 0;  ///< another number since the last jump of time or reset
  int64_t id = 0;    ///< of its first frame
};

/// All that one keyframe is made of. The image is decoded and rectified later, by the worker.
struct KeyframeInput : CaptureOrigin {
  std::shared_ptr<const EncodedImage> image;
  std::shared_ptr<const EncodedImage> mask;         ///< of the image as sent; null: it has none
  std::shared_ptr<const EncodedImage> prior_depth;  ///< the same
  std::shared_ptr<const EncodedImage> labels;       ///< the same
  CalibrationPtr calibration;
  std::vector<SourceImage> source_images;  ///< of source cameras, as far as they came
  std::vector<Eigen::Vector3d> landmarks_in_world;
  double scene_depth = 0;  ///< median of the landmarks in front of the last cameras, or the fallback; 0 = unknown
};

/// The frontend goes on in another world, see WorldTracker: what comes must not be mixed with what came.
struct NewWorld {
  std::string text;
};

using IntakeEvent = std::variant<KeyframeInput, TimeJump, NewWorld, RejectedInput, Notice>;

/// From samples of the input streams to posed images: matches them and places the clouds in the world. Knows messages
/// but no topics. Not thread-safe.
class KeyframeIntake {
 public:
  /// @param fallback_depth stands in for the scene's depth while no landmarks tell; 0 = unknown
  KeyframeIntake(const NodeOptions& options, double fallback_depth, const TransformSource& transforms = {});

  /// @param arrival_s steady clock, for latencies
  void AddImage(std::shared_ptr<const EncodedImage> image, double arrival_s = 0);
  /// Throws InvalidInputError for a camera that cannot be used; images then wait for a better one.
  void AddCameraInfo(const sensor_msgs::CameraInfo& info);
  void AddPose(PoseSample pose);
  void SetExtrinsic(const RigidTransform& received) { resolver_.SetExtrinsic(received); }
  /// All of a keyframe at once; see AddCameraInfo. Throws InvalidInputError if any part cannot be used.
  void AddKeyframe(const acmp_mapping::KeyframeConstPtr& keyframe, double arrival_s = 0);
  void AddCloud(SparseCloudPtr cloud) { matcher_.AddCloud(std::move(cloud)); }
  void AddCompanion(size_t stream, ImageSample sample) { matcher_.AddCompanion(stream, std::move(sample)); }
  /// Throws InvalidInputError for a camera that cannot be used; its images are then not used.
  /// @param camera from 0, below ~source_cameras
  void AddSourceCameraInfo(size_t camera, const sensor_msgs::CameraInfo& info) { sources_.AddCameraInfo(camera, info); }
  void set_clouds_expected(bool expected) { matcher_.set_clouds_expected(expected); }
  void set_companion_expected(size_t stream, bool expected) { matcher_.set_companion_expected(stream, expected); }
  void set_fallback_depth(double fallback_depth) { fallback_depth_ = fallback_depth; }

  /// What has happened since the last call, in order; see InputMatcher.
  std::vector<IntakeEvent> Take(double now_s);
  std::vector<IntakeEvent> TakeAll();

  /// Forgets images, poses and clouds; the camera stays known.
  void Clear();

  /// For a pose, or for the frontend's world to settle.
  size_t waiting_images() const { return matcher_.waiting_images() + starting_.size(); }
  size_t unposed_images() const { return matcher_.UnposedStamps().size(); }
  /// What of the poses' meaning may be wrong, after messages about poses that do not fit the images; may be empty.
  std::string DescribeDoubt() const;
  /// Of the poses, with the T_body_cam in use.
  const PoseSemantics& pose_semantics() const { return resolver_.semantics(); }

  /// What images wait for longer than they should: "T_body_cam is not known: ..."; empty while all is well. Poses count
  /// only until the first image has got one: many frontends pose some images alone.
  std::string DescribeWait(double now_s) const;
  const std::optional<PoseGap>& last_gap() const { return matcher_.last_gap(); }
  const PoseUse& pose_use() const { return matcher_.pose_use(); }
  /// Share of the first keyframes' sparse points, 0..1; none before the first point.
  std::optional<double> share_in_front() const { return convention_check_.share_in_front(); }
  const std::string& convention_warning() const { return convention_check_.warning(); }

 private:
  void Prepare();
  void UpdateObstacle();
  std::string CameraFrame() const;
  void LookUpPoses();
  std::vector<IntakeEvent> Convert(std::vector<MatchEvent> events);
  void Convert(const MatchedInput& match, std::vector<IntakeEvent>* events);
  /// Says once that ~world_frame replaces the frame of the poses.
  void TellReplacedFrame(const std::string& frame, std::vector<IntakeEvent>* events);
  /// Asks the WorldTracker whether the image can be used.
  void CheckWorld(KeyframeInput input, bool has_empty_cloud, std::vector<IntakeEvent>* events);
  void RejectStarting(const std::string& reason, const std::string& message, std::vector<IntakeEvent>* events);
  /// Those that wait while the frontend starts are used.
  void UseStarting(std::vector<IntakeEvent>* events);
  void StartOver();
  PathConvention MakePathConvention() const;
  /// Whether the cloud is in the camera's frame, else in the world's; none, and why in `events`, if that is not known.
  std::optional<bool> IsInCamera(const MatchedInput& match, const KeyframeInput& input,
                                 std::vector<IntakeEvent>* events) const;
  std::vector<Eigen::Vector3d> PlaceCloud(const MatchedInput& match, const KeyframeInput& input,
                                          std::vector<IntakeEvent>* events);

  NodeOptions options_;
  TransformSource transforms_;
  InputMatcher matcher_;
  SourceCameras sources_;
  PoseResolver resolver_;
  ConventionCheck convention_check_;
  WorldTracker world_;
  std::vector<KeyframeInput> starting_;  ///< wait for the frontend's world to settle
  std::vector<IntakeEvent> forgotten_;   ///< what Clear has to tell
  double fallback_depth_;
  double scene_depth_ =
      0;  ///< of the last posed image: median of the landmarks that were last in front of the camera; 0 = none yet
  CalibrationHistory calibrations_;
  std::string image_frame_;     ///< of the last image
  std::string child_frame_;     ///< of the last pose
  std::string replaced_frame_;  ///< of poses: the last that ~world_frame was told to replace
  bool matched_ = false;        ///< an image has got its pose since the start
};

}  // namespace acmp
