#pragma once

#include <Eigen/Geometry>

namespace acmp {

/// Rigid motion. Names read target_from_source: `point_in_cam = cam_from_world * point_in_world`.
using RigidTransform = Eigen::Isometry3d;

}  // namespace acmp
