#pragma once

namespace acmp {

struct FusionOptions {
  float max_reprojection_px = 2.0f;      ///< forward-backward error, > 0
  float max_relative_depth = 0.01f;      ///< (0, 1)
  float max_normal_angle_deg = 10.0f;    ///< (0, 180]
  int min_consistent_views = 2;          ///< source views that must agree, 1..32
  bool dynamic_consistency = false;      ///< ACMMP: sum exp(-(px + 200 rel + 10 rad)) > 0.3 n instead of the thresholds
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const FusionOptions& options);

}  // namespace acmp
