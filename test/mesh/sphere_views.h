#pragma once

#include <cmath>
#include <vector>

#include "acmp_mapping/mesh/splat_points.h"

namespace acmp::test {

constexpr double kSphereRadius = 0.5;
constexpr Rgb kSphereColor = {200, 100, 51};

/// What a camera at `position` that looks along `forward` sees of a sphere around the origin, exactly.
inline SurfaceMaps SeeSphere(const Eigen::Vector3d& position) {
  SurfaceMaps maps;
  maps.camera.camera = {120, 100, 110, 110, 59.5, 49.5};
  const Eigen::Vector3d forward = -position.normalized();
  const Eigen::Vector3d right = Eigen::Vector3d::UnitZ().cross(forward).normalized();
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.linear() << right, forward.cross(right), forward;
  world_from_cam.translation() = position;
  maps.camera.cam_from_world = world_from_cam.inverse();
  const PinholeCamera& camera = maps.camera.camera;
  maps.depth = DepthMap(camera.width, camera.height);
  maps.normal = NormalMap(camera.width, camera.height);
  maps.confidence = ConfidenceMap(camera.width, camera.height);
  maps.color = ColorImage(camera.width, camera.height, kSphereColor);
  const Eigen::Vector3d center = maps.camera.cam_from_world * Eigen::Vector3d(0, 0, 0);
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = camera.Unproject({col, row});
      const double along = ray.dot(center), squared = ray.squaredNorm();
      const double root = along * along - squared * (center.squaredNorm() - kSphereRadius * kSphereRadius);
      if (root <= 0) continue;
      const double depth = (along - std::sqrt(root)) / squared;
      const Eigen::Vector3d normal = (depth * ray - center).normalized();
      maps.depth(col, row) = static_cast<float>(depth);
      maps.normal(col, row) = {static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                               static_cast<float>(normal.z())};
      maps.confidence(col, row) = 0.9f;
    }
  }
  return maps;
}

/// From four sides; the poles are seen at a slant.
inline std::vector<SurfaceMaps> SeeSphereFromAround() {
  std::vector<SurfaceMaps> views;
  for (const auto& [x, y] : {std::pair{1.5, 0.2}, {-0.2, 1.5}, {-1.5, -0.2}, {0.2, -1.5}}) {
    views.push_back(SeeSphere({x, y, 0.1}));
  }
  return views;
}

inline Eigen::Vector3d Position(const SurfacePoint& point) {
  return {point.position.x, point.position.y, point.position.z};
}

inline Eigen::Vector3d Normal(const SurfacePoint& point) { return {point.normal.x, point.normal.y, point.normal.z}; }

}  // namespace acmp::test
