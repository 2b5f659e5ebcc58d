#pragma once

#include <Eigen/Core>

#include "acmp_mapping/common/vector_math.h"

namespace acmp {

inline Eigen::Vector3d ToEigen(const Vec3f& v) { return {v.x, v.y, v.z}; }

inline Vec3f ToVec3f(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

inline Mat3f ToMat3f(const Eigen::Matrix3d& matrix) {
  Mat3f result;
  for (int i = 0; i < 9; ++i) result.m[i] = static_cast<float>(matrix(i / 3, i % 3));
  return result;
}

}  // namespace acmp
