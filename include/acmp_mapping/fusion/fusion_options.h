#pragma once

namespace acmp {

/// Which pixels become points. A source view agrees with a pixel within all three limits ("lower than", as the paper
/// says). The papers keep what two views agree with (2 px, 1 %, 10 degrees), and nothing else.
struct FusionOptions {
  /// A pixel must be right with this probability (ConfidenceOf), 0..1. The default is where the F1 of maps is best.
  float min_confidence = 0.35f;
  /// Source views that must agree, 0..32. With 0 the probability alone decides, also of pixels that were filled; each
  /// then weighs by how well it agrees. The depth limit is twice the paper's: the scale of a SLAM system's poses
  /// wanders by as much between keyframes.
  int min_consistent_views = 0;
  float max_reprojection_px = 2.0f;    ///< forward-backward error, > 0
  float max_relative_depth = 0.02f;    ///< (0, 1)
  float max_normal_angle_deg = 30.0f;  ///< (0, 180]
};

}  // namespace acmp
