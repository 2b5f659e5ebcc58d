#pragma once

#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/backend/make_patch_match.h"
#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/parameter_reader.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

enum class ImageTransport { kRaw, kCompressed };
enum class SparseFrame { kAuto, kWorld, kCamera };
enum class PoseSource { kPose, kPoseWithCovariance, kOdometry, kTransform, kTf };
enum class KeyframeMode {
  kEveryPose,
  kGate,
  kExternal,  ///< the frontend's own keyframes, on the topic `keyframe` alone
};
/// What is read once when the nodelet is loaded. Every field is a private parameter of the name beside it; enumerations
/// are the names of their values in lower_case.
struct NodeOptions {
  Device device = Device::kAuto;    ///< device: auto, cuda, cpu
  int cuda_device = 0;              ///< cuda_device: 0-based, 0..63
  std::string preset = "balanced";  ///< preset: see MakePreset; start values of matching parameters
  ImageTransport image_transport = ImageTransport::kRaw;  ///< image_transport: raw, compressed
  bool rectified = false;        ///< rectified: images are undistorted already; camera_info's P holds
  int max_image_size = 640;      ///< max_image_size: longer side that is matched [px]; 0 = as sent, ..100000
  std::string calibration_file;  ///< calibration_file: the camera, in place of camera_info; empty = none
  PoseSource pose_source = PoseSource::kPose;      ///< pose_source: pose, pose_cov, odom, transform, tf
  PoseSemantics pose;                              ///< pose_is, pose_child, T_body_cam (4x4, row by row)
  std::optional<PoseSemantics::Child> path_child;  ///< path_child: of optimized_path; empty = pose_child
  bool extrinsic_inverted = false;                 ///< extrinsic_inverted: the topic `extrinsic` has T_cam_body
  std::string world_frame;                         ///< world_frame: replaces the poses' frame_id; empty = as sent
  std::string camera_frame;                        ///< camera_frame: replaces the images' frame_id; empty = as sent
  std::string body_frame;  ///< body_frame: replaces the poses' child frame in tf; empty = as sent
  SparseFrame sparse_frame = SparseFrame::kAuto;          ///< sparse_frame: auto, world, camera
  InputMatcherOptions matcher;                            ///< sync_tolerance, sparse_tolerance, sparse_wait [s]
  KeyframeMode keyframe_mode = KeyframeMode::kEveryPose;  ///< keyframe_mode: every_pose, gate, external
  OverloadPolicy overload = OverloadPolicy::kDropOldest;  ///< overload: drop_oldest, skip_if_busy, block
};

/// Whether T_body_cam is needed and not a parameter: then it is looked up in tf and awaited on the topic extrinsic.
bool NeedsExtrinsic(const NodeOptions& options);

/// What the poses of optimized_path mean.
PoseSemantics PathSemantics(const NodeOptions& options);

/// Throws InvalidInputError naming the parameter and what it may be.
NodeOptions LoadNodeOptions(ParameterReader* reader);

}  // namespace acmp
