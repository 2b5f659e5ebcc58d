#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/pose_refinement/pose_fit.h"
#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

namespace acmp {

struct RefinedPose {
  int64_t id = 0;
  /// In the world of the refined poses; the received one, bit by bit, unless `changed`.
  RigidTransform cam_from_world = RigidTransform::Identity();
  /// The same in the world of the received poses, to which `scale` takes lengths.
  RigidTransform cam_from_received = RigidTransform::Identity();
  /// What has to be taken out of the image, beside radial distortion, for cam_from_world to be its pose; nothing: the
  /// pose is that of the image as it is. Of RefineImagePoses only.
  ReadoutMotion readout;
  PoseFit received_fit;  ///< matches of this image with all others, with the poses as received
  PoseFit refined_fit;   ///< and with refined ones, whether they are used or not
};

struct PoseRefinement {
  bool changed = false;
  std::string reason;    ///< why poses stay as they are; empty when they change
  PoseFit received_fit;  ///< of all images
  PoseFit refined_fit;
  /// Length in the world of the received poses of what is 1 in that of the refined ones. A sliding window carries its
  /// own scale on, which then does not wander as a monocular frontend's does.
  double scale = 1;
  /// Of a sliding window: which world refined poses are in. Another number: they began again from received ones.
  uint64_t world = 0;
  PoseChecks checks;  ///< of sliding windows; of sets of images the camera's errors alone
  /// Received poses: a bundle adjustment that took a camera with errors for one without has adjusted them.
  bool bent = false;
  int landmarks = 0;               ///< that took part
  std::vector<RefinedPose> poses;  ///< in the order of the images
};

/// An image of a set, as RefineImagePoses takes it.
struct PosedImage {
  int64_t id = 0;
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  DepthRange depth_range;    ///< where its landmarks are looked for
  std::vector<int> sources;  ///< positions of the images that see the same, best first
};

/// What of an image is matched.
struct ImagePixels {
  GrayImage gray;
  Mask mask;  ///< of the same size; empty: all pixels count
};

/// Refines the poses of an image set by a bundle adjustment over matches that it finds itself. `images` are in the
/// order in which they were taken, as far as there is one. The same input gives the same bits. Works in parallel (TBB).
/// Throws InvalidInputError for bad options, depth ranges or indices, and whatever `load` throws.
/// @param load gives the pixels of the image at a position, of its camera's size; called by several threads
/// @param frees where poses are changed and the camera has errors, they are those of images freed from these: from
///   radial distortion as in `camera`, and from each image's `readout`; false: those of images as they are
/// @param check called after each parallel loop, to throw where that was cancelled; may be empty
PoseRefinement RefineImagePoses(const std::vector<PosedImage>& images, const std::function<ImagePixels(size_t)>& load,
                                const PoseRefinementOptions& options, bool frees = true,
                                const std::function<void()>& check = {});

}  // namespace acmp
