#pragma once

#include "bundle.h"

namespace acmp {

/// A known point and where a view sees it.
struct SeenPoint {
  Eigen::Vector3d point;  ///< world
  Eigen::Vector2d pixel;
};

/// The pose from which the points are seen best where their pixels are, from `start` on: robust Gauss-Newton (Cauchy).
/// Returns `start` where the points do not tell it.
ViewPose Resect(const std::vector<SeenPoint>& points, const PinholeCamera& camera, const ViewPose& start);

/// For each view the pose from which a pinhole camera without errors sees the adjusted landmarks best where their
/// pixels are: what whoever matches images as they are needs. A view with too few landmarks keeps its pose.
/// @param camera what has been found out about the cameras: anchors' pixels are freed from it
/// @param first_view views before it are left out
/// @return poses of the views from `first_view` on
std::vector<ViewPose> ResectViews(const Bundle& bundle, const CameraErrors& camera, size_t first_view = 0);

}  // namespace acmp
