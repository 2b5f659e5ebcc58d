#pragma once

#include "bundle.h"

namespace acmp {

/// Standard deviations of what a bundle adjustment weighs against each other.
struct BundleWeights {
  double pixel_sigma = 0.3;      ///< px, of a sighting along each axis
  double rotation_sigma = 0.02;  ///< rad, of a received orientation about each axis
  double position_sigma = 0.05;  ///< scene units, of a received position along each axis
  double turn_sigma = 0.01;      ///< rad, of the received rotation from view to view about each axis
  double move_sigma = 0.02;      ///< scene units, of the received motion from view to view along each axis
  CameraErrors camera_sigma;     ///< of the camera's errors about what they were before
};

/// Adjusts poses, inverse depths of landmarks that are not held out, and the camera's errors. Robust (Cauchy); received
/// poses, received motions from view to view and the camera's errors are priors: a view without landmarks moves with
/// its neighbours. Poses are then those at the middle row of an image without distortion. The first `fixed_views` stay
/// as they are. One thread, so that results do not depend on the machine. Returns false, with the poses as they were,
/// where the solver finds no solution.
[[nodiscard]] bool AdjustBundle(const BundleWeights& weights, int max_iterations, size_t fixed_views, Bundle* bundle,
                                CameraErrors* camera);

}  // namespace acmp
