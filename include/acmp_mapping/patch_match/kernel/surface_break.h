#pragma once

#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// Whether the surface of the present estimates bends or breaks (a crease or a depth discontinuity) within the pixel's
/// window: inverse depth is affine on a plane, so that a pixel of one has the mean of any two opposite ones. Compared
/// with four pairs on the window's rim, those that lie in the image and have planes (without one the difference is NaN,
/// which no comparison finds greater). They are of the other colour, which no one writes
/// meanwhile.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline bool IsSurfaceBroken(const MatchContext<Sampler>& context, int col, int row,
                                             const Group& group) {
  const auto inverse_depth = [&](int x, int y) {
    return PlaneInverseDepth(context.planes(x, y), context.rays.Ray(static_cast<float>(x), static_cast<float>(y)));
  };
  constexpr int kPairs = 4;  // (5, 0), (0, 5), (4, 3), (4, -3): at the same distance, and dx + dy is odd
  static_assert(kPatchRadius == 5, "the pairs lie on the rim");
  const float own = inverse_depth(col, row);
  bool broken = false;
  ForEach(group, kPairs, [&](int i) {
    const int dx = i == 0 ? 5 : i == 1 ? 0 : 4;
    const int dy = i == 0 ? 0 : i == 1 ? 5 : i == 2 ? 3 : -3;
    if (!context.Contains(col + dx, row + dy) || !context.Contains(col - dx, row - dy)) return;
    const float bend = inverse_depth(col + dx, row + dy) + inverse_depth(col - dx, row - dy) - 2.0f * own;
    broken = broken || fabsf(bend) > context.options.edge_bend * own;
  });
  return group.Any(broken);
}

}  // namespace acmp
