#pragma once

#include <vector>

#include "acmp_mapping/fusion/fusion_options.h"
#include "acmp_mapping/fusion/kernel/confidence.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// One image's maps as fusion sees them; the pixels belong to the caller. Sizes of different views may differ; an empty
/// depth map takes no part.
struct FusionView {
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  ImageView<const float> depth;   ///< z, 0 = unknown
  ImageView<const Vec3f> normal;  ///< camera frame
  ImageView<const float> cost;    ///< see CostMap; from kWorstCost on unconfirmed: confirms no other pixel
  ImageView<const Rgb> color;     ///< may be empty: points are black
};

/// What source views say of a reference view.
struct ConsistencyResult {
  ConfidenceMap confidence;     ///< probability that the depth is right (ConfidenceOf); 0 without depth
  PointCloud points_in_camera;  ///< of pixels that FusionOptions keeps, averaged with agreeing views; reference frame
};

/// Checks one reference view against source views (FusionOptions; paper, "Fusion"). A source's depth is that of its
/// nearest pixel's plane at the place (DepthAtPlace), with min_consistent_views > 0 that of the pixel; a pixel without
/// a normal agrees with nothing. Points come in row-major order. Throws InvalidInputError for maps that do not fit
/// their camera, poses that are not rigid and more than 255 sources. Does not modify or mark the sources.
ConsistencyResult FilterByConsistency(const FusionView& reference, const std::vector<FusionView>& sources,
                                      const FusionOptions& options);

}  // namespace acmp
