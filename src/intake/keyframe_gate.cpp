#include "acmp_mapping/intake/keyframe_gate.h"

#include <Eigen/Geometry>

#include "acmp_mapping/common/error.h"

namespace acmp {

void Validate(const KeyframeGateOptions& options) {
  CheckRange("gate_baseline_ratio", options.min_baseline_ratio, 0.0, 10.0);
  CheckRange("gate_angle_deg", options.min_angle_deg, 1e-3, 180.0);
}

bool KeyframeGate::Accept(const RigidTransform& world_from_cam, double median_depth) {
  bool accept = true;
  if (last_) {
    constexpr double kDegPerRad = 57.29577951308232;
    const RigidTransform motion = last_->inverse() * world_from_cam;
    const double baseline = motion.translation().norm();
    const double angle_deg = Eigen::AngleAxisd(motion.linear()).angle() * kDegPerRad;
    const double min_baseline = median_depth > 0 ? options_.min_baseline_ratio * median_depth : 0;
    accept = (baseline > 0 && baseline >= min_baseline) || angle_deg >= options_.min_angle_deg;
  }
  if (accept) last_ = world_from_cam;
  return accept;
}

}  // namespace acmp
