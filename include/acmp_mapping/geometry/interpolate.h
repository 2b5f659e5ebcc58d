#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// On the way from `a` (part 0) to `b` (part 1) as a body moves that keeps its velocity and rate of turn: along a
/// screw. The same motion whichever of two frames the transforms map to the other, and of any frames that are fixed to
/// these.
inline RigidTransform Interpolate(const RigidTransform& a, const RigidTransform& b, double part) {
  constexpr double kTurns = 1e-9;  // rad
  const RigidTransform motion = a.inverse() * b;
  const Eigen::AngleAxisd turn(motion.linear());
  const Eigen::Vector3d& shift = motion.translation();
  RigidTransform moved(Eigen::AngleAxisd(part * turn.angle(), turn.axis()));
  if (std::abs(turn.angle()) < kTurns) {
    moved.translation() = part * shift;
    return a * moved;
  }
  // Chasles: a turn about a line, and a shift along it.
  const Eigen::Vector3d along = turn.axis().dot(shift) * turn.axis(), across = shift - along;
  const Eigen::Vector3d on_line = 0.5 * (across + turn.axis().cross(across) / std::tan(0.5 * turn.angle()));
  moved.translation() = part * along + on_line - moved.linear() * on_line;
  return a * moved;
}

}  // namespace acmp
