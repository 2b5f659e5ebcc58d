#pragma once

#include <Eigen/Core>

#include "acmp_mapping/common/vector_math.h"

namespace acmp {

inline Eigen::Vector3d ToEigen(const Vec3f& v) { return {v.x, v.y, v.z}; }

inline Vec3f ToVec3f(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

inline Vec3d ToVec3d(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

inline Mat3d ToMat3d(const Eigen::Matrix3d& m) {
  return {{m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)}};
}

}  // namespace acmp
