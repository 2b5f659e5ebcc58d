#pragma once

#include "acmp_mapping/completion/kernel/completion_grid.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {

/// Sightings of a pixel of the reference; 0 without a depth, which nobody sees. A view confirms it within the limits on
/// reprojection and depth, closely within two thirds of the latter, nearly within twice the one and four times the
/// other. Normals do not count: where there is little texture they are noise, and the depths still agree.
template <class View>
ACMP_HOST_DEVICE inline Sightings LookAtPixel(const FusionContext<View>& context, int col, int row) {
  ReferencePixel pixel;
  if (!LoadReferencePlace(context, col, row, &pixel)) return 0;
  constexpr double kNearlySquaredPx = 4, kNearlyDepth = 4, kCloselyDepth = 2.0 / 3;
  int confirming = 0, closely_confirming = 0, looking_through = 0;
  bool is_nearly_confirmed = false;
  for (int i = 0; i < context.num_sources; ++i) {
    SourcePlace place;
    Sighting sighting;
    if (!LocateInSource(context.sources[i], pixel.homogeneous, &place)) continue;
    if (!LookBack(context.sources[i], pixel, place, &sighting)) continue;
    if (LooksThrough(sighting)) ++looking_through;
    const double squared_px = context.limits.max_squared_px, relative_depth = context.limits.max_relative_depth;
    is_nearly_confirmed |=
        sighting.squared_px < kNearlySquaredPx * squared_px && sighting.relative_depth < kNearlyDepth * relative_depth;
    const bool confirms = sighting.squared_px < squared_px && sighting.relative_depth < relative_depth;
    confirming += confirms ? 1 : 0;
    closely_confirming += confirms && sighting.relative_depth < kCloselyDepth * relative_depth ? 1 : 0;
  }
  return PackSightings(confirming, closely_confirming, is_nearly_confirmed, looking_through);
}

}  // namespace acmp
