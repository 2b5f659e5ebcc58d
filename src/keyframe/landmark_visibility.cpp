#include "acmp_mapping/keyframe/landmark_visibility.h"

#include <algorithm>
#include <cmath>

namespace acmp {

bool IsLandmark(const Eigen::Vector3d& point_in_world) {
  return point_in_world.allFinite() && !(point_in_world.array() == 0).all();
}

double DepthInView(const Eigen::Vector3d& point_in_world, const PinholeCamera& camera,
                   const RigidTransform& cam_from_world) {
  const Eigen::Vector3d point_in_cam = cam_from_world * point_in_world;
  if (!(point_in_cam.z() > 0) || !std::isfinite(point_in_cam.z())) return 0;
  return camera.Contains(camera.Project(point_in_cam)) ? point_in_cam.z() : 0;
}

std::vector<Eigen::Vector3d> WithoutMasked(std::vector<Eigen::Vector3d> landmarks_in_world, const PinholeCamera& camera,
                                           const RigidTransform& cam_from_world, const Mask& mask) {
  if (mask.empty()) return landmarks_in_world;
  const auto is_masked = [&](const Eigen::Vector3d& point) {
    if (DepthInView(point, camera, cam_from_world) <= 0) return false;
    const Eigen::Vector2d pixel = camera.Project(cam_from_world * point);
    const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, mask.width() - 1);
    const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, mask.height() - 1);
    return mask(col, row) == 0;
  };
  landmarks_in_world.erase(std::remove_if(landmarks_in_world.begin(), landmarks_in_world.end(), is_masked),
                           landmarks_in_world.end());
  return landmarks_in_world;
}

LandmarksInView FindLandmarksInView(const std::vector<Eigen::Vector3d>& landmarks_in_world, const PinholeCamera& camera,
                                    const RigidTransform& cam_from_world) {
  LandmarksInView in_view;
  for (const Eigen::Vector3d& point : landmarks_in_world) {
    if (!IsLandmark(point)) continue;
    const double depth = DepthInView(point, camera, cam_from_world);
    if (depth <= 0) continue;
    in_view.points_in_world.push_back(point);
    in_view.depths.push_back(depth);
  }
  return in_view;
}

}  // namespace acmp
