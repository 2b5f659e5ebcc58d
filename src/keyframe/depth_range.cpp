#include "acmp_mapping/keyframe/depth_range.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

/// The value below which a share `quantile` of the sorted values lies (nearest rank).
double SortedQuantile(const std::vector<double>& sorted, double quantile) {
  return sorted[static_cast<size_t>(std::lround(quantile * static_cast<double>(sorted.size() - 1)))];
}

}  // namespace

void CheckDepthRange(const char* name, const DepthRange& range) {
  if (!(range.min > 0 && range.min < range.max && std::isfinite(range.max))) {
    throw InvalidInputError(
        Concat(name, ": depth range [", range.min, ", ", range.max, "]: must satisfy 0 < min < max < inf"));
  }
}

std::optional<DepthRange> DepthRangeFromLandmarks(const std::vector<Eigen::Vector3d>& landmarks_in_world,
                                                  const PinholeCamera& camera, const RigidTransform& cam_from_world) {
  std::vector<double> depths = FindLandmarksInView(landmarks_in_world, camera, cam_from_world).depths;
  if (depths.size() < kMinDepthLandmarks) return std::nullopt;
  std::sort(depths.begin(), depths.end());
  const DepthRange range = {static_cast<float>(SortedQuantile(depths, kDepthQuantile) / kDepthMargin),
                            static_cast<float>(SortedQuantile(depths, 1 - kDepthQuantile) * kDepthMargin)};
  // Beyond what a float holds: nothing to search.
  if (!(range.min > 0 && range.min < range.max && std::isfinite(range.max))) return std::nullopt;
  return range;
}

}  // namespace acmp
