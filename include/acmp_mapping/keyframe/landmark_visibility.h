#pragma once

#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// False for what frontends publish in place of a point: a coordinate that is not finite, or exactly (0, 0, 0).
bool IsLandmark(const Eigen::Vector3d& point_in_world);

/// Depth z > 0 of a point that projects into the image, else 0. Occlusion is not known here.
double DepthInView(const Eigen::Vector3d& point_in_world, const PinholeCamera& camera,
                   const RigidTransform& cam_from_world);

/// The landmarks without those that fall on a pixel of the image which its mask ignores, in their order.
/// @param mask of the camera's size, or empty
std::vector<Eigen::Vector3d> WithoutMasked(std::vector<Eigen::Vector3d> landmarks_in_world, const PinholeCamera& camera,
                                           const RigidTransform& cam_from_world, const Mask& mask);

/// The landmarks that project into the image, in their order, with their depths z.
struct LandmarksInView {
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<double> depths;
};
LandmarksInView FindLandmarksInView(const std::vector<Eigen::Vector3d>& landmarks_in_world, const PinholeCamera& camera,
                                    const RigidTransform& cam_from_world);

}  // namespace acmp
