#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// Checkerboard median of depth: the pixel itself, its 16 nearest pixels of the other colour and
/// the four at distance 5 along the axes. The pixel keeps its
/// normal and its plane is moved to the median depth, so normal and depth stay consistent. Reads the other colour only.
template <class Sampler>
ACMP_HOST_DEVICE inline void FilterPixel(const MatchContext<Sampler>& context, int col, int row) {
  constexpr int kCount = 21;
  const int dx[kCount] = {0, 0, 0, -1, 1, -1, 1, -1, 1, -2, 2, -2, 2, 0, 0, -3, 3, 0, 0, -5, 5};
  const int dy[kCount] = {0, -1, 1, 0, 0, -2, -2, 2, 2, -1, -1, 1, 1, -3, 3, 0, 0, -5, 5, 0, 0};
  float sorted[kCount];
  int count = 0;
  for (int i = 0; i < kCount; ++i) {
    const int c = col + dx[i], r = row + dy[i];
    if (!context.Contains(c, r)) continue;
    const float depth =
        PlaneDepth(context.planes(c, r), context.rays.Ray(static_cast<float>(c), static_cast<float>(r)));
    int slot = count++;
    for (; slot > 0 && depth < sorted[slot - 1]; --slot) sorted[slot] = sorted[slot - 1];
    sorted[slot] = depth;
  }
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const PlaneHypothesis plane = context.planes(col, row);
  context.planes(col, row) = PlaneThrough(plane.normal(), ray, sorted[count / 2]);
}

}  // namespace acmp
