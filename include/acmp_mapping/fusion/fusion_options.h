#pragma once

namespace acmp {

/// When a source view agrees with a pixel (all three limits, as the paper says: "lower than"), and when a pixel with n
/// agreeing views is kept. The depth limit is twice the paper's: the scale of a SLAM system's poses wanders by as much
/// between keyframes, and the reprojection error tells wrong depths where there is a baseline.
struct FusionOptions {
  float max_reprojection_px = 2.0f;    ///< forward-backward error, > 0
  float max_relative_depth = 0.02f;    ///< (0, 1)
  float max_normal_angle_deg = 10.0f;  ///< (0, 180]
  int min_consistent_views = 2;        ///< source views that must agree, 1..32
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const FusionOptions& options);

}  // namespace acmp
