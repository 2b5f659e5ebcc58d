#pragma once

#include <Eigen/Core>
#include <cmath>

#include "acmp_mapping/geometry/lens.h"

namespace acmp::test {

/// Where a lens puts the ray (x, y, 1), px: the models' formulas as OpenCV and COLMAP document them.
inline Eigen::Vector2d Distort(const PinholeCamera& camera, const LensDistortion& distortion, double x, double y) {
  const auto k = [&](size_t i) { return i < distortion.coefficients.size() ? distortion.coefficients[i] : 0.0; };
  const double r2 = x * x + y * y;
  double xd, yd;
  if (distortion.model == LensDistortion::Model::kEquidistant) {
    const double r = std::sqrt(r2), t = std::atan(r), t2 = t * t;
    const double bent = t * (1 + t2 * (k(0) + t2 * (k(1) + t2 * (k(2) + t2 * k(3)))));
    xd = r > 0 ? x * bent / r : x;
    yd = r > 0 ? y * bent / r : y;
  } else {
    const double radial = (1 + r2 * (k(0) + r2 * (k(1) + r2 * k(4)))) / (1 + r2 * (k(5) + r2 * (k(6) + r2 * k(7))));
    xd = x * radial + 2 * k(2) * x * y + k(3) * (r2 + 2 * x * x);
    yd = y * radial + k(2) * (r2 + 2 * y * y) + 2 * k(3) * x * y;
  }
  return {xd * camera.fx + camera.cx, yd * camera.fy + camera.cy};
}

/// The ray (x, y, 1) that a lens puts at a pixel: the inverse, by fixed-point iteration.
inline Eigen::Vector2d RayAt(const PinholeCamera& camera, const LensDistortion& distortion, double u, double v) {
  Eigen::Vector2d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector2d error = Distort(camera, distortion, ray.x(), ray.y()) - Eigen::Vector2d(u, v);
    ray -= Eigen::Vector2d(error.x() / camera.fx, error.y() / camera.fy);
  }
  return ray;
}

}  // namespace acmp::test
