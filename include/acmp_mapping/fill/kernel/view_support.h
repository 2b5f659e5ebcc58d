#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {

/// ViewSupport of a pixel of the reference; 0 without a depth, which nobody sees. A view confirms it within the limits
/// on reprojection and depth, closely within two thirds of the latter, nearly within twice the one and four times the
/// other. Normals do not count: where there is little texture they are noise, and the depths still agree.
template <class View>
ACMP_HOST_DEVICE inline ViewSupport CountSupportingViews(const FusionContext<View>& context, int col, int row) {
  ReferencePixel pixel;
  if (!LoadReferencePlace(context, col, row, &pixel)) return 0;
  constexpr double kNearlySquaredPx = 4, kNearlyDepth = 4, kCloselyDepth = 2.0 / 3;
  int confirming = 0, strictly_consistent = 0, free_space_violations = 0;
  bool is_loosely_consistent = false;
  for (int i = 0; i < context.num_sources; ++i) {
    SourcePlace place;
    ViewAgreement agreement;
    if (!LocateInSource(context.sources[i], pixel.homogeneous, &place)) continue;
    if (context.sources[i].view.IsGuess(place.col, place.row)) continue;
    if (!ProjectBack(context.sources[i], context.limits, pixel, place, &agreement)) continue;
    if (ViolatesFreeSpace(agreement)) ++free_space_violations;
    const double squared_px = context.limits.max_squared_px, relative_depth = context.limits.max_relative_depth;
    is_loosely_consistent |= agreement.squared_px < kNearlySquaredPx * squared_px &&
                             agreement.relative_depth < kNearlyDepth * relative_depth;
    const bool confirms = agreement.squared_px < squared_px && agreement.relative_depth < relative_depth;
    confirming += confirms ? 1 : 0;
    strictly_consistent += confirms && agreement.relative_depth < kCloselyDepth * relative_depth ? 1 : 0;
  }
  return PackViewSupport(confirming, strictly_consistent, is_loosely_consistent, free_space_violations);
}

}  // namespace acmp
