#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

constexpr int kMedianPixels = 21;

/// Pairs of places that, exchanged in this order where they are out of order, sort the values: Batcher's merge exchange
/// (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M). Known to the compiler, so that a GPU thread keeps
/// the values in registers.
struct SortingNetwork {
  int low[kMedianPixels * kMedianPixels / 2] = {}, high[kMedianPixels * kMedianPixels / 2] = {};
  int count = 0;

  ACMP_HOST_DEVICE constexpr SortingNetwork() {
    int top = 1;  // largest power of two below the number of values
    while (2 * top < kMedianPixels) top *= 2;
    for (int p = top; p > 0; p /= 2) {
      int q = top, rest = 0, distance = p;
      for (;;) {
        for (int i = 0; i + distance < kMedianPixels; ++i) {
          if ((i & p) != rest) continue;
          low[count] = i;
          high[count++] = i + distance;
        }
        if (q == p) break;
        distance = q - p;
        q /= 2;
        rest = p;
      }
    }
  }
};

struct DepthStatistics {
  float median;
  float spread;  ///< width of the middle half
};

/// Of the smallest `count` values, which are sorted on the way (no NaN).
ACMP_HOST_DEVICE inline DepthStatistics Statistics(float (&values)[kMedianPixels], int count) {
  constexpr SortingNetwork network;
  ACMP_UNROLL
  for (int i = 0; i < network.count; ++i) {
    const float a = values[network.low[i]], b = values[network.high[i]];
    values[network.low[i]] = Smaller(a, b);
    values[network.high[i]] = Larger(a, b);
  }
  float median = 0, low = 0, high = 0;
  ACMP_UNROLL
  for (int i = 0; i < kMedianPixels; ++i) {
    if (i == count / 2) median = values[i];
    if (i == count / 4) low = values[i];
    if (i == 3 * count / 4) high = values[i];
  }
  return {median, high - low};
}

constexpr int kMedianReach = 5;  ///< px to the farthest of the pixels below

/// What MedianFilterPixel does.
/// @tparam kAllInside the pixel is at least kMedianReach from the image's border and from what its mask ignores.
/// Nothing has to be asked before the others are read then, so that a GPU thread waits once for all, and the ranks are
/// known to the compiler.
template <bool kAllInside, class Sampler>
ACMP_HOST_DEVICE inline void MedianFilterPixelAmong(const MatchContext<Sampler>& context, int col, int row) {
  constexpr int dx[kMedianPixels] = {0, 0, 0, -1, 1, -1, 1, -1, 1, -2, 2, -2, 2, 0, 0, -3, 3, 0, 0, -5, 5};
  constexpr int dy[kMedianPixels] = {0, -1, 1, 0, 0, -2, -2, 2, 2, -1, -1, 1, 1, -3, 3, 0, 0, -5, 5, 0, 0};
  constexpr float kFar = 1e30f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  float own[kMedianPixels], extended[kMedianPixels];
  int count = kAllInside ? kMedianPixels : 0;
  ACMP_UNROLL
  for (int i = 0; i < kMedianPixels; ++i) {
    own[i] = extended[i] = kFar;
    const int c = col + dx[i], r = row + dy[i];
    if (!kAllInside) {
      if (!context.Contains(c, r) || context.IsMasked(c, r)) continue;
      ++count;
    }
    const PlaneHypothesis plane = context.planes(c, r);
    own[i] = PlaneDepth(plane, context.rays.Ray(static_cast<float>(c), static_cast<float>(r)));
    const float depth = PlaneDepth(plane, ray);
    if (context.InRange(depth)) extended[i] = depth;
  }
  const DepthStatistics depths = Statistics(own, count), slopes = Statistics(extended, count);
  const bool keeps_slope = slopes.median < kFar && slopes.spread < depths.spread;
  const PlaneHypothesis plane = context.planes(col, row);
  const float depth = keeps_slope ? slopes.median : depths.median;
  context.planes(col, row) = PlaneThrough(plane.normal(), ray, depth);
}

/// Checkerboard median of depth over the pixel itself, its 16 nearest pixels of the other colour and the four at
/// distance 5 along the axes. Either their depths, which evens out noise where normals are poor, or the depths at which
/// their planes meet this pixel's ray, which keeps slopes: whichever spread less. A plane that leaves the depth range
/// on the way counts as infinitely far. The pixel keeps its normal and its plane is moved to the median, so normal and
/// depth stay consistent. Reads the other colour only. A pixel that the mask ignores has no plane and does not count.
template <class Sampler>
ACMP_HOST_DEVICE inline void MedianFilterPixel(const MatchContext<Sampler>& context, int col, int row) {
  if (context.IsMasked(col, row)) return;
  if (context.Contains(col - kMedianReach, row - kMedianReach) &&
      context.Contains(col + kMedianReach, row + kMedianReach) && !context.IsNearMasked(col, row, kMedianReach)) {
    MedianFilterPixelAmong<true>(context, col, row);
  } else {
    MedianFilterPixelAmong<false>(context, col, row);
  }
}

}  // namespace acmp
