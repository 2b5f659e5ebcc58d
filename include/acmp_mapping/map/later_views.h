#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// How many later keyframes saw a surface where a point is, and how many saw through it (a free-space violation in
/// Merrell et al., Real-Time Visibility-Based Fusion of Depth Maps, ICCV 2007); 255 at most.
struct LaterViews {
  uint8_t confirming = 0;
  uint8_t through = 0;
};

/// What a keyframe saw, as a depth map made of its points; empty without points.
struct SeenDepth {
  PinholeCamera camera;
  DepthMap depth;
};

/// @param spacing of the points, > 0
SeenDepth SeenDepthOf(const PointCloud& points_in_camera, double spacing);

/// Takes what a later keyframe saw to what is known of an earlier one's points. A point goes that three later keyframes
/// or more see through, and more than twice as many as confirm it: it was never there, or has moved since. The odds of
/// others rise by a fifth with each keyframe that confirms them, and fall by half with each that sees through them.
/// Nothing changes where the keyframe sees through more points than it confirms: then the poses do not fit together.
/// @param later_from_points from the points' frame, in which they are multiplied by `scale` first, to the later
/// camera's
/// @param views one per point
/// @return whether anything was changed
bool TakeLaterView(const SeenDepth& seen, const RigidTransform& later_from_points, double scale, PointCloud* points,
                   std::vector<LaterViews>* views);

}  // namespace acmp
