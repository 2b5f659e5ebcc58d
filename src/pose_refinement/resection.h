#pragma once

#include "bundle.h"

namespace acmp {

/// For each view the pose from which a pinhole camera without errors sees the adjusted landmarks best where their
/// pixels are: what whoever matches images as they are needs. A view with too few landmarks keeps its pose.
/// @param camera what has been found out about the cameras: anchors' pixels are freed from it
/// @param first_view views before it are left out
/// @return poses of the views from `first_view` on
std::vector<ViewPose> ResectViews(const Bundle& bundle, const CameraErrors& camera, size_t first_view = 0);

}  // namespace acmp
