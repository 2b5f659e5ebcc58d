#pragma once

#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/common/option.h"
#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/parameter_reader.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

constexpr char kAutoPreset[] = "auto";  ///< value of `preset`: AutoPreset

enum class ImageTransport { kRaw, kCompressed };
enum class SparseFrame { kAuto, kWorld, kCamera };
enum class PoseSource { kPose, kPoseWithCovariance, kOdometry, kTransform, kTf };
enum class KeyframeMode {
  kEveryPose,
  kGate,
  kExternal,  ///< the frontend's own keyframes, on the topic `keyframe` alone
};

/// What is read once when the nodelet is loaded; NodeOptionTable says what each means and what it may be.
struct NodeOptions {
  Device device = Device::kAuto;
  int cuda_device = 0;  ///< 0-based
  std::string preset = "balanced";
  ImageTransport image_transport = ImageTransport::kRaw;
  bool rectified = false;
  int max_image_size = 640;  ///< px, longer side; 0 = as sent
  std::string calibration_file;
  std::string mask_file;  ///< of the image as sent; empty = none
  PoseSource pose_source = PoseSource::kPose;
  PoseSemantics pose;
  std::optional<PoseSemantics::Child> path_child;  ///< of optimized_path; none = as the poses
  bool extrinsic_inverted = false;                 ///< the topic `extrinsic` has T_cam_body
  std::string world_frame;                         ///< empty = as sent, as the next two
  std::string camera_frame;
  std::string body_frame;
  SparseFrame sparse_frame = SparseFrame::kAuto;
  InputMatcherOptions matcher;
  KeyframeMode keyframe_mode = KeyframeMode::kEveryPose;
  OverloadPolicy overload = OverloadPolicy::kDrop;
  double memory_limit_gb = kMemoryLimitGb;  ///< of a message while it is worked on
};

const OptionTable<NodeOptions>& NodeOptionTable();

/// Whether T_body_cam is needed and not a parameter: then it is looked up in tf and awaited on the topic extrinsic.
bool NeedsExtrinsic(const NodeOptions& options);

/// What the poses of optimized_path mean.
PoseSemantics PathSemantics(const NodeOptions& options);

/// Throws InvalidInputError naming the parameter and what it may be.
NodeOptions LoadNodeOptions(ParameterReader* reader);

}  // namespace acmp
