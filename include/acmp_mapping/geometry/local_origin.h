#pragma once

#include <Eigen/Core>

namespace acmp {

/// Where the coordinates begin in which float32 holds what is around a place: zero where that is within `reach` of the
/// world's origin, else the place in whole steps. float32 has 24 bits: in UTM or geocentric coordinates (millions of
/// metres) it knows half metres only, while doubles hold any place. So poses stay double, points are kept from a local
/// origin, and what leaves is their sum.
/// @param step > 0, unit of the place; a power of two keeps the origin exact
inline Eigen::Vector3d LocalOrigin(const Eigen::Vector3d& place, double reach, double step) {
  if (!(place.cwiseAbs().maxCoeff() > reach)) return Eigen::Vector3d::Zero();
  return (place / step).array().round() * step;
}

}  // namespace acmp
