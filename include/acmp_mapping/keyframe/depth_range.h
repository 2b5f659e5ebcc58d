#pragma once

#include <optional>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// Depths z searched for one image, scene units.
struct DepthRange {
  float min = 0;
  float max = 0;
};

/// Throws InvalidInputError unless 0 < min < max < inf. `name` starts the message.
void CheckDepthRange(const char* name, const DepthRange& range);

struct DepthRangeOptions {
  double quantile = 0.05;   ///< share of landmarks dropped at each end, [0, 0.5)
  double margin = 1.5;      ///< near end divided by it, far end multiplied, >= 1
  int min_landmarks = 10;   ///< fewer in view: no range
};
void Validate(const DepthRangeOptions& options);

/// Range of the depths of the landmarks in view (design: [q05 / 1.5, q95 * 1.5]). Points that are not finite, exactly
/// zero, behind the camera or outside the image are left out. None when too few remain.
std::optional<DepthRange> DepthRangeFromLandmarks(const std::vector<Eigen::Vector3d>& landmarks_in_world,
                                                  const PinholeCamera& camera, const RigidTransform& cam_from_world,
                                                  const DepthRangeOptions& options);

}  // namespace acmp
