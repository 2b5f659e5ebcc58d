#pragma once

#include <cfloat>
#include <cmath>

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

// Weighted median filters are an old remedy of stereo (Ma et al., Constant Time Weighted Median Filtering for Stereo
// Matching and Beyond, ICCV 2013); here of slanted planes, of which free-space violations count less.
//
// A window of 11 x 11 px takes the depth of what is nearer up to 5 px beside it, so the filter sees more than twice as
// far: every fourth pixel of 25 x 25.
constexpr int kMedianStep = 4;  ///< px
constexpr int kMedianAcross = 7;
constexpr int kMedianSamples = kMedianAcross * kMedianAcross;

/// Maps of the reference as the filter reads and writes them.
struct MedianContext {
  RayGrid rays;
  float depth_min, depth_max;
  ImageView<const PlaneHypothesis> planes;  ///< before
  ImageView<const float> depth;             ///< of these
  ImageView<const ViewSupport> support;     ///< what the sources see of these (CountSupportingViews)
  ImageView<const Rgb> color;               ///< may be empty: colours do not count then
  ImageView<PlaneHypothesis> filtered;      ///< others than `planes`
  ImageView<float> cost;
};

/// Surfaces around a pixel, those of one of `kThreads` threads, row by row. In one array each, all of them used and
/// every index known to the compiler, so that a GPU thread has them in registers.
template <int kThreads>
struct MedianSamples {
  static constexpr int kRows = (kMedianAcross + kThreads - 1) / kThreads;  ///< the last may be one too many
  static constexpr int kCount = kRows * kMedianAcross;
  float depth[kCount];   ///< of the surface extended to the pixel
  float weight[kCount];  ///< 0: none
};

/// Of the n-th column or row of samples, px from the pixel.
ACMP_HOST_DEVICE constexpr int SampleOffset(int n) { return (n - kMedianAcross / 2) * kMedianStep; }

ACMP_HOST_DEVICE inline int Clamped(int value, int last) { return value < 0 ? 0 : value > last ? last : value; }

/// Depth of a neighbour's plane on the pixel's ray. The neighbour's own where the plane, seen so obliquely, leaves that
/// within a few pixels, or leaves the depth range. 0 where the plane does not face the pixel.
ACMP_HOST_DEVICE inline float ExtendedDepth(const MedianContext& context, const PlaneHypothesis& plane,
                                            const Vec3f& ray, float depth) {
  constexpr float kMaxChange = 0.1f;
  const float facing = Dot(plane.normal(), ray);
  const float extended = -plane.d * Reciprocal(facing);
  const bool holds =
      fabsf(extended - depth) <= kMaxChange * depth && extended >= context.depth_min && extended <= context.depth_max;
  return facing < 0 ? (holds ? extended : depth) : 0;
}

/// Whether depths around the pixel differ, by more than one in twenty: elsewhere there is nothing to choose from.
template <class Group>
ACMP_HOST_DEVICE inline bool HasSeveralSurfaces(const MedianContext& context, int col, int row, const Group& group) {
  constexpr float kSameSurfaces = 1.05f;
  float nearest = FLT_MAX, farthest = 0;
  const int last_col = context.depth.width - 1, last_row = context.depth.height - 1;
  ACMP_UNROLL
  for (int i = 0; i < MedianSamples<Group::kSize>::kRows; ++i) {
    const int sample_row = Clamped(group.Rank() + i * Group::kSize, kMedianAcross - 1);
    const int r = Clamped(row + SampleOffset(sample_row), last_row);
    ACMP_UNROLL
    for (int k = 0; k < kMedianAcross; ++k) {
      const float depth = context.depth(Clamped(col + SampleOffset(k), last_col), r);
      nearest = depth > 0 && depth < nearest ? depth : nearest;
      farthest = depth > farthest ? depth : farthest;
    }
  }
  return group.Greatest(farthest) > kSameSurfaces * group.Least(nearest);
}

/// What the sources that see through a sample leave of its weight, a quarter each. One may be wrong itself; the more,
/// the less likely.
ACMP_HOST_DEVICE inline float ShareOfWeight(int free_space_violations) {
  static_assert(kMaxFreeSpaceViolations == 3, "two bits");
  return ((free_space_violations & 1) != 0 ? 1 / 4.0f : 1.0f) * ((free_space_violations & 2) != 0 ? 1 / 16.0f : 1.0f);
}

/// Those inside the image with a depth in the range. All are loaded, so that a GPU does not wait for one before it asks
/// for the next.
template <class Group>
ACMP_HOST_DEVICE inline MedianSamples<Group::kSize> FindMedianSamples(const MedianContext& context, int col, int row,
                                                                      const Group& group) {
  constexpr float kInverseColorReach = 1 / 15.0f;    // summed over three channels: the weight falls by e
  constexpr float kInverseDistanceReach = 1 / 8.0f;  // px
  const int last_col = context.depth.width - 1, last_row = context.depth.height - 1;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const bool has_color = !context.color.empty();
  const Rgb own = has_color ? context.color(col, row) : Rgb{0, 0, 0};
  MedianSamples<Group::kSize> samples;
  ACMP_UNROLL
  for (int i = 0; i < samples.kCount; ++i) {
    const int sample_row = group.Rank() + i / kMedianAcross * Group::kSize;
    const int dx = SampleOffset(i % kMedianAcross), dy = SampleOffset(sample_row);
    const int c = Clamped(col + dx, last_col), r = Clamped(row + dy, last_row);
    const bool is_inside = sample_row < kMedianAcross && c == col + dx && r == row + dy;
    const float depth = context.depth(c, r);
    const bool counts = is_inside && depth >= context.depth_min && depth <= context.depth_max;
    const float share = ShareOfWeight(FreeSpaceViolations(context.support(c, r)));
    const int color = has_color ? ColorDistance(own, context.color(c, r)) : 0;
    const float distance = sqrtf(static_cast<float>(dx * dx + dy * dy));
    const float weight = expf(-(static_cast<float>(color) * kInverseColorReach + distance * kInverseDistanceReach));
    samples.depth[i] = ExtendedDepth(context, context.planes(c, r), ray, depth);
    samples.weight[i] = counts && samples.depth[i] > 0 ? share * weight : 0;
  }
  return samples;
}

/// Number of the nearest sample up to which lies half of the weight or more, or of one that is nearer by less than a
/// thousandth of all depths' range; -1 of none.
template <class Group>
ACMP_HOST_DEVICE inline int WeightedMedianOf(const MedianSamples<Group::kSize>& samples, const Group& group) {
  constexpr int kBisections = 10;
  float nearest = FLT_MAX, farthest = 0, half = 0;
  ACMP_UNROLL
  for (int i = 0; i < samples.kCount; ++i) {
    const bool counts = samples.weight[i] > 0;
    nearest = counts && samples.depth[i] < nearest ? samples.depth[i] : nearest;
    farthest = counts && samples.depth[i] > farthest ? samples.depth[i] : farthest;
    half += 0.5f * samples.weight[i];
  }
  half = group.Sum(half);
  if (!(half > 0)) return -1;
  // Less than half of the weight lies up to `low`, half or more up to `high`.
  float low = 0.999f * group.Least(nearest), high = group.Greatest(farthest);
  for (int bisection = 0; bisection < kBisections; ++bisection) {
    const float middle = 0.5f * (low + high);
    float up_to = 0;
    ACMP_UNROLL
    for (int i = 0; i < samples.kCount; ++i) up_to += samples.depth[i] <= middle ? samples.weight[i] : 0;
    (group.Sum(up_to) < half ? low : high) = middle;
  }
  int median = 0;
  float depth = FLT_MAX;
  ACMP_UNROLL
  for (int i = 0; i < samples.kCount; ++i) {
    const bool is_nearer = samples.weight[i] > 0 && samples.depth[i] > low && samples.depth[i] < depth;
    depth = is_nearer ? samples.depth[i] : depth;
    median = is_nearer ? i : median;
  }
  const int row = group.Rank() + median / kMedianAcross * Group::kSize;
  const int number = row * kMedianAcross + median % kMedianAcross;
  return group.Least(depth == group.Least(depth) ? number : kMedianSamples);
}

/// The weighted median of the surfaces around: of those of the pixel's colour, and the nearer ones first. Pixels that
/// sources see through have less say. Where the depth changes by more than one in a hundred, the cost is that of
/// another surface: whoever fuses maps has to ask the views again. A pixel without a depth goes on having none.
template <class Group = SingleThread>
ACMP_HOST_DEVICE inline void WeightedMedianPixel(const MedianContext& context, int col, int row,
                                                 const Group& group = {}) {
  constexpr float kSameSurface = 0.01f;
  const bool is_first = group.Rank() == 0;
  if (is_first) context.filtered(col, row) = context.planes(col, row);
  if (!(context.depth(col, row) > 0)) return;  // the mask ignores the pixel
  if (FreeSpaceViolations(context.support(col, row)) == 0 && !HasSeveralSurfaces(context, col, row, group)) return;
  const int median = WeightedMedianOf(FindMedianSamples(context, col, row, group), group);
  if (median < 0 || !is_first) return;
  const int c = col + SampleOffset(median % kMedianAcross), r = row + SampleOffset(median / kMedianAcross);
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const PlaneHypothesis& plane = context.planes(c, r);
  const float depth = ExtendedDepth(context, plane, ray, context.depth(c, r));
  context.filtered(col, row) = PlaneThrough(plane.normal(), ray, depth);
  const float before = context.depth(col, row);
  if (fabsf(depth - before) <= kSameSurface * before) return;
  context.cost(col, row) = Larger(context.cost(col, row), kUnverifiedCost);
}

}  // namespace acmp
