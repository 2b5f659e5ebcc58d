#pragma once

#include "bundle.h"

namespace acmp {

/// Standard deviations of what a bundle adjustment weighs against each other.
struct BundleWeights {
  double pixel_sigma = 0.3;      ///< px, of a sighting along each axis
  double rotation_sigma = 0.02;  ///< rad, of a received orientation about each axis
  double position_sigma = 0.05;  ///< scene units, of a received position along each axis
  CameraErrors camera_sigma;     ///< of the camera's errors about what they were before
};

/// Adjusts poses, inverse depths of landmarks that are not held out, and the camera's errors. Robust (Cauchy); received
/// poses and the camera's errors are priors. Poses are then those at the middle row of an image without distortion.
/// The first `fixed_views` poses stay as they are. One thread, so that results do not depend on the machine. Throws
/// ProcessingError where the solver fails.
void AdjustBundle(const BundleWeights& weights, int max_iterations, size_t fixed_views, Bundle* bundle,
                  CameraErrors* camera);

}  // namespace acmp
