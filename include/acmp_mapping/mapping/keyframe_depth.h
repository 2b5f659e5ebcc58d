#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/point_losses.h"
#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/pose_refinement/pose_fit.h"

namespace acmp {

/// Depth of one keyframe with all that belongs to it. Maps have the size of frame->camera. Never modified.
struct KeyframeDepth {
  FramePtr frame;
  /// Where it lies: the frame's, or the refined one where that puts it as the window lay then.
  RigidTransform cam_from_world = RigidTransform::Identity();
  std::optional<RefinedCamera> refined_camera;  ///< none: the pose is the frame's
  PoseFit pose_fit;                             ///< how well that fits; no matches: not measured
  DepthRange range;                             ///< that was searched, scene units
  DepthMap depth;                               ///< z in the camera's frame, scene units
  // Of refined maps only; empty for fast ones.
  NormalMap normal;                             ///< unit vectors in the camera's frame, towards the camera
  CostMap cost;                                 ///< 0..kWorstCost or kUnsupportedCost, see CostMap
  ConfidenceMap confidence;                     ///< 0..1
  PointCloud points_in_camera;                  ///< pixels that enough source views confirm
  std::optional<std::string> no_points_reason;  ///< Describe(PointLosses), where no pixel is confirmed
  std::string prior_depth_rejection;            ///< why the frame's prior depth is used nowhere; else empty
  std::vector<int64_t> source_ids;              ///< keyframes it was matched against, best first
  StageTimes times;                             ///< summed over all steps since it was last refined
  double consistency_ms = 0;                    ///< wall time of the consistency check
  bool refined = false;                         ///< false: fast maps of steps 1-20; true: after all steps
};
using KeyframeDepthPtr = std::shared_ptr<const KeyframeDepth>;

/// Why a keyframe gave no refined maps. `reason` is a short fixed key for counting, `message` a sentence with the
/// values.
/// - "invalid_input": the frame, or the problem made of it, was refused
/// - "no_depth_range": neither landmarks nor matches nor an earlier range nor a fallback
/// - "no_source_views": left the window, or was flushed, before enough views of it were useful
/// - "poses_contradict": the received poses contradict the images, and did when it left the window or was flushed
/// - "processing_error": device failure or no memory
/// - "reset": forgotten by Reset
struct KeyframeDrop {
  FramePtr frame;
  std::string reason;
  std::string message;
  bool had_fast = false;  ///< on_fast was called for it: only the refined maps are missing
};

}  // namespace acmp
