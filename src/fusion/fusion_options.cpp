#include "acmp_mapping/fusion/fusion_options.h"

#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {

void Validate(const FusionOptions& options) {
  if (!(options.max_reprojection_px > 0 && std::isfinite(options.max_reprojection_px))) {
    throw InvalidInputError(
        Concat("fusion.max_reprojection_px = ", options.max_reprojection_px, ": must be > 0 and finite"));
  }
  if (!(options.max_relative_depth > 0 && options.max_relative_depth < 1)) {
    throw InvalidInputError(Concat("fusion.max_relative_depth = ", options.max_relative_depth, ": must be in (0, 1)"));
  }
  if (!(options.max_normal_angle_deg > 0 && options.max_normal_angle_deg <= 180)) {
    throw InvalidInputError(
        Concat("fusion.max_normal_angle_deg = ", options.max_normal_angle_deg, ": must be in (0, 180]"));
  }
  CheckRange("fusion.min_consistent_views", options.min_consistent_views, 0, 32);
  CheckRange("fusion.min_confidence", options.min_confidence, 0.0f, 1.0f);
}

}  // namespace acmp
