#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/label.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// One undistorted, posed image with the sparse map points it sees. Immutable once made and shared by reference.
struct Frame {
  int64_t id = 0;      ///< unique; ascending in time when the frames come from a video
  double stamp_s = 0;  ///< time of exposure; 0 where there is none
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  ColorImage color;
  GrayImage gray;  ///< what is matched
  /// Which pixels count, of the same size: the others are neither matched nor matched against, and get no depth. Empty
  /// where all count.
  Mask mask;
  /// Sparse map points that this image is said to see (observed, or a whole map: what is not in view is ignored by all
  /// who read them), without those that fall on pixels which the mask ignores: they may be of something that moves.
  std::vector<Eigen::Vector3d> landmarks_in_world;
  /// Depth z from outside (a network, another sensor), of the same size, up to what PriorDepthOptions says; 0: unknown.
  /// Empty: none.
  DepthMap prior_depth = {};
  LabelImage labels = {};  ///< of the same size; empty: none
};

using FramePtr = std::shared_ptr<const Frame>;

/// Images that cameras which are fixed to each other took at one time. The pose of the first one is the capture's, also
/// if that image cannot be used; how the others lie to it is never changed, and is in the unit of the poses.
struct Capture {
  std::vector<FramePtr> keyframes;   ///< get maps; those with a common centre are no source views of each other
  std::vector<FramePtr> companions;  ///< are source views only, and need no colours
};

/// Makes a frame from an undistorted image: grey values in float, both resized, the camera and the mask with them.
/// Throws InvalidInputError for a camera, image or mask size that does not fit, a pose that is not finite and
/// orthonormal, or a negative max_size.
/// @param max_size longer side of the frame, px; 0: the image's
/// @param mask of the image; empty: all pixels count
/// @param prior_depth of the whole image at any size: pixels of the frame take the nearest of its pixels, since between
///   two surfaces there is none; what is not positive and finite is unknown. Empty: none
/// @param labels the same
Frame MakeFrame(int64_t id, double stamp_s, ColorImage color, const PinholeCamera& camera,
                const RigidTransform& cam_from_world, std::vector<Eigen::Vector3d> landmarks_in_world, int max_size = 0,
                const Mask& mask = {}, const DepthMap& prior_depth = {}, const LabelImage& labels = {});

/// The points as a PointCloud2 carries them: every coordinate rounded to float, returned in double.
std::vector<Eigen::Vector3d> RoundedToFloat(const std::vector<Eigen::Vector3d>& points);

/// Throws InvalidInputError unless the pose is finite and its rotation orthonormal within 1e-3.
void CheckPose(const char* name, const RigidTransform& pose);

}  // namespace acmp
