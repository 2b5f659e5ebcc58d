#pragma once

#include <optional>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// How far the camera must have moved for the next keyframe; either suffices. Neither needs a metric scale.
struct KeyframeGateOptions {
  double min_baseline_ratio = 0.05;  ///< baseline / median scene depth, 0..10; 0.05 = 3 degrees of parallax
  double min_angle_deg = 10;         ///< rotation, (0, 180]
};
void Validate(const KeyframeGateOptions& options);

/// Chooses keyframes among posed images for frontends that give a pose to every image.
class KeyframeGate {
 public:
  void set_options(const KeyframeGateOptions& options) { options_ = options; }

  /// Whether this pose is a keyframe; if so, the next ones are compared with it. While the scene's depth is unknown
  /// (`median_depth` <= 0) every moved pose is one, or the scene would never become known.
  bool Accept(const RigidTransform& world_from_cam, double median_depth);

  /// The next pose is a keyframe again.
  void Reset() { last_.reset(); }

 private:
  KeyframeGateOptions options_;
  std::optional<RigidTransform> last_;  ///< world_from_cam
};

}  // namespace acmp
