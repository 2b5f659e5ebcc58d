#pragma once

#include <cmath>

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp::test {

/// Solid angle of a pixel of a cube's face, sr; 0 outside of the cube's face, where the next face has it.
inline double SolidAngle(const PinholeCamera& camera, int col, int row) {
  const Eigen::Vector3d ray = camera.Unproject({static_cast<double>(col), static_cast<double>(row)});
  if (std::abs(ray.x()) > 1 || std::abs(ray.y()) > 1) return 0;
  return std::pow(ray.norm(), -3) / (camera.fx * camera.fy);
}

}  // namespace acmp::test
