#pragma once

#include <type_traits>
#include <utility>

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// On functions of vectors of floats: their caller chooses the instructions that they are made of.
#define ACMP_ALWAYS_INLINE __attribute__((always_inline))

constexpr int kMedianPixels = 21;

/// Pairs of places that, exchanged in this order where they are out of order, sort the values: Batcher's merge exchange
/// (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M). Known to the compiler, so that values stay in
/// registers.
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

/// Leaves the smaller of two values in `low` and the larger in `high`. @tparam T float, or a vector of floats
template <class T>
ACMP_HOST_DEVICE ACMP_ALWAYS_INLINE inline void PutInOrder(T* low, T* high) {
  const T a = *low, b = *high;
  *low = b < a ? b : a;
  *high = b < a ? a : b;
}
ACMP_HOST_DEVICE ACMP_ALWAYS_INLINE inline void PutInOrder(float* low, float* high) {
  const float a = *low, b = *high;
  *low = Smaller(a, b);
  *high = Larger(a, b);
}

template <class T, int... kPairs>
ACMP_HOST_DEVICE ACMP_ALWAYS_INLINE inline void SortByNetwork(T (&values)[kMedianPixels],
                                                              std::integer_sequence<int, kPairs...>) {
  constexpr SortingNetwork network;
  (PutInOrder(values + std::integral_constant<int, network.low[kPairs]>::value,
              values + std::integral_constant<int, network.high[kPairs]>::value),
   ...);
}

template <class T>
struct DepthStatistics {
  T median;
  T spread;  ///< width of the middle half
};

/// Of the values, which are sorted on the way (no NaN). @tparam T float, or a vector of floats: of each lane
template <class T>
ACMP_HOST_DEVICE ACMP_ALWAYS_INLINE inline void FindStatistics(T (&values)[kMedianPixels],
                                                               DepthStatistics<T>* statistics) {
  constexpr SortingNetwork network;
  SortByNetwork(values, std::make_integer_sequence<int, network.count>());
  statistics->median = values[kMedianPixels / 2];
  statistics->spread = values[3 * kMedianPixels / 4] - values[kMedianPixels / 4];
}

/// Of the smallest `count` values.
ACMP_HOST_DEVICE inline void FindStatistics(float (&values)[kMedianPixels], int count,
                                            DepthStatistics<float>* statistics) {
  constexpr SortingNetwork network;
  SortByNetwork(values, std::make_integer_sequence<int, network.count>());
  float median = 0, low = 0, high = 0;
  ACMP_UNROLL
  for (int i = 0; i < kMedianPixels; ++i) {
    if (i == count / 2) median = values[i];
    if (i == count / 4) low = values[i];
    if (i == 3 * count / 4) high = values[i];
  }
  *statistics = {median, high - low};
}

/// Column and row of neighbour `i` from the pixel, px; the first is the pixel itself.
struct MedianOffsets {
  int col[kMedianPixels] = {0, 0, 0, -1, 1, -1, 1, -1, 1, -2, 2, -2, 2, 0, 0, -3, 3, 0, 0, -5, 5};
  int row[kMedianPixels] = {0, -1, 1, 0, 0, -2, -2, 2, 2, -1, -1, 1, 1, -3, 3, 0, 0, -5, 5, 0, 0};
};

constexpr float kBeyondRange = 1e30f;  ///< depth of a plane that leaves the depth range

constexpr int kMedianReach = 5;  ///< px to the farthest of the pixels below

/// What MedianFilterPixel does.
/// @tparam kAllInside the pixel is at least kMedianReach from the image's border and from what its mask ignores.
/// Nothing has to be asked before the others are read then, so that a GPU thread waits once for all, and the ranks are
/// known to the compiler.
template <bool kAllInside, class Sampler>
ACMP_HOST_DEVICE inline void MedianFilterPixelAmong(const MatchContext<Sampler>& context, int col, int row) {
  constexpr MedianOffsets offsets;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  float own[kMedianPixels], extended[kMedianPixels];
  int count = 0;
  ACMP_UNROLL
  for (int i = 0; i < kMedianPixels; ++i) {
    own[i] = extended[i] = kBeyondRange;
    const int c = col + offsets.col[i], r = row + offsets.row[i];
    if (!kAllInside) {
      if (!context.Contains(c, r) || context.IsMasked(c, r)) continue;
      ++count;
    }
    const PlaneHypothesis plane = context.planes(c, r);
    own[i] = PlaneDepth(plane, context.rays.Ray(static_cast<float>(c), static_cast<float>(r)));
    const float depth = PlaneDepth(plane, ray);
    if (context.InRange(depth)) extended[i] = depth;
  }
  DepthStatistics<float> depths, slopes;
  if constexpr (kAllInside) {
    FindStatistics(own, &depths);
    FindStatistics(extended, &slopes);
  } else {
    FindStatistics(own, count, &depths);
    FindStatistics(extended, count, &slopes);
  }
  const bool keeps_slope = slopes.median < kBeyondRange && slopes.spread < depths.spread;
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
