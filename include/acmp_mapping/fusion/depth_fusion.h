#pragma once

#include <vector>

#include "acmp_mapping/fusion/fusion_options.h"
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
  ImageView<const float> cost;    ///< 0..2; for the confidence
  ImageView<const Rgb> color;     ///< may be empty: points are black
};

/// Pixels of a reference view that its source views confirm.
struct ConsistencyResult {
  Image<unsigned char> consistent_views;  ///< number of source views that agree with the pixel
  ConfidenceMap confidence;               ///< see ComputeConfidence; 0 without depth
  PointCloud points_in_camera;            ///< pixels with enough consistent views, averaged with them; reference frame
};

/// Checks one reference view against source views: 2 px forward-backward reprojection, 1 % depth, 10 degrees by default
/// (paper, "Fusion"). Source depths are looked up at the nearest pixel; a pixel without a normal agrees with nothing.
/// Points come in row-major order. Throws InvalidInputError for maps that do not fit their camera, poses that are not
/// rigid and more than 255 sources. Does not modify or mark the sources.
ConsistencyResult FilterByConsistency(const FusionView& reference, const std::vector<FusionView>& sources,
                                      const FusionOptions& options);

/// Confidence 0..1 of a pixel from its matching cost (0..2), the number of consistent source views and their median
/// triangulation angle: C = 0.2 P + 0.5 S + 0.3 P S, P = exp(-cost^2 / 0.18), S = 1 - 2^(-n min(angle / 10 deg, 1)).
/// Never falls when the cost falls or the views or the angle grow. The median of an even number is the mean of the
/// middle two; without consistent views the angle is 0.
float ComputeConfidence(float cost, int consistent_views, float angle_deg);

/// Fuses all views of a scene into one cloud in the world frame. `neighbors[i]` are the source views of view i:
/// distinct, and not i. A pixel that went into a point is not used again, neither averaged nor counted as agreeing;
/// views are visited in the order given, pixels row by row, so the same input gives the same cloud.
PointCloud FuseDepthMaps(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                         const FusionOptions& options);

}  // namespace acmp
