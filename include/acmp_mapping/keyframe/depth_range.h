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

/// Share of landmarks dropped at each end of their range, and by what the near end is divided and the far end
/// multiplied. Wide on purpose: landmarks are rare on the blank surfaces that the prior is for. With 5 % and 1.5 up to
/// a third of a real image lay nearer than the range (15 % over one scene); with 2 % and 2 it is 0.1 %, and what a
/// wider range costs the random start was too little to measure.
constexpr double kDepthQuantile = 0.02, kDepthMargin = 2.0;

constexpr size_t kMinDepthLandmarks = 10;  ///< fewer in view: no range

/// Range of the depths of the landmarks in view, [q02 / 2, q98 * 2]. Points that are not finite, exactly
/// zero, behind the camera or outside the image are left out. None when fewer than kMinDepthLandmarks remain.
std::optional<DepthRange> DepthRangeFromLandmarks(const std::vector<Eigen::Vector3d>& landmarks_in_world,
                                                  const PinholeCamera& camera, const RigidTransform& cam_from_world);

}  // namespace acmp
