#pragma once

#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/keyframe/depth_range.h"

namespace acmp {

/// One image as PatchMatch sees it; the pixels belong to the caller and must outlive the run.
struct MatchView {
  ImageView<const float> gray;  ///< 0..255
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  ImageView<const float> depth;  ///< z, 0 = unknown; empty unless the pass is geometric (source views only)
  ImageView<const unsigned char> mask_distance;  ///< MaskDistanceMap of the image's mask; empty: all pixels count
};

/// Input of a pass: one reference view, 1..32 source views (sizes may differ) and the depths to search.
struct PatchMatchProblem {
  MatchView reference;
  std::vector<MatchView> sources;
  DepthRange depth_range;
};

/// Throws InvalidInputError unless images and cameras agree, there are 1..32 sources each with a baseline, and the
/// depth range is valid.
void Check(const PatchMatchProblem& problem);

/// All that a pass leaves behind and the next one starts from. Both maps have the reference's size.
struct EstimateState {
  PlaneMap planes;  ///< once a pass has run all pixels but those that the mask ignores have a plane before the camera
  CostMap cost;     ///< photometric (eq. 1) after the photometric and prior passes, eq. 13 after geometric ones

  EstimateState Clone() const { return {planes.Clone(), cost.Clone()}; }
};

}  // namespace acmp
