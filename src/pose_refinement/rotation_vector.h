#pragma once

#include <Eigen/Geometry>

namespace acmp {

/// Axis times angle, the shorter way round.
inline Eigen::Vector3d RotationVector(const Eigen::Quaterniond& rotation) {
  const Eigen::Vector3d v = rotation.w() < 0 ? Eigen::Vector3d(-rotation.vec()) : Eigen::Vector3d(rotation.vec());
  const double sine = v.norm(), cosine = std::abs(rotation.w());
  return sine < 1e-12 ? Eigen::Vector3d(2 * v) : Eigen::Vector3d(2 * std::atan2(sine, cosine) / sine * v);
}

inline Eigen::Quaterniond RotationAbout(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle < 1e-12) return Eigen::Quaterniond(1, vector.x() / 2, vector.y() / 2, vector.z() / 2).normalized();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle));
}

inline Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0).finished();
}

}  // namespace acmp
