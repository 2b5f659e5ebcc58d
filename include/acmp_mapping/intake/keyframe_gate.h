#pragma once

#include <cstddef>
#include <deque>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

struct KeyframeGateOptions {
  double min_baseline_ratio = 0.02;  ///< baseline / median scene depth, 0..10; 0.02 = 1.1 degrees of parallax
  size_t remembered = 30;            ///< keyframes that a view is compared with, > 0: as many as the window has
};

/// Chooses keyframes among posed images for frontends that give a pose to every image.
///
/// A posed image is a keyframe if its camera has moved, by the given share of the scene's depth: away from the last
/// keyframe, and from every other remembered one that shows the same view. So neither a camera that stands and sways
/// nor one that turns on the spot, of which no depth can be had, pushes older views out of the window; and the scale of
/// the poses does not matter.
class KeyframeGate {
 public:
  void set_options(const KeyframeGateOptions& options) { options_ = options; }

  /// Whether this image is a keyframe; if so, later ones are compared with it. While the scene's depth is unknown
  /// (`median_depth` <= 0) every moved pose is one, or the scene would never become known.
  bool Accept(const RigidTransform& world_from_cam, const PinholeCamera& camera, double median_depth);

  /// The next pose is a keyframe again.
  void Reset() { keyframes_.clear(); }

 private:
  KeyframeGateOptions options_;
  std::deque<RigidTransform> keyframes_;  ///< world_from_cam, newest last
};

}  // namespace acmp
