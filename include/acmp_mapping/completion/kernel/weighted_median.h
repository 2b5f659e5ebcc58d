#pragma once

#include <cfloat>
#include <cmath>

#include "acmp_mapping/completion/kernel/completion_grid.h"

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
  ImageView<const Sightings> sightings;     ///< what the sources see of these (LookAtPixel)
  ImageView<const Rgb> color;               ///< may be empty: colours do not count then
  ImageView<PlaneHypothesis> filtered;      ///< others than `planes`
  ImageView<float> cost;
};

/// Surfaces around a pixel. In one array each, all of them used and every index known to the compiler, so that a GPU
/// thread has them in registers.
struct MedianSamples {
  float depth[kMedianSamples];   ///< of the surface extended to the pixel
  float weight[kMedianSamples];  ///< 0: none
};

/// Of the n-th sample, px from the pixel.
ACMP_HOST_DEVICE inline int SampleOffsetX(int n) { return (n % kMedianAcross - kMedianAcross / 2) * kMedianStep; }
ACMP_HOST_DEVICE inline int SampleOffsetY(int n) { return (n / kMedianAcross - kMedianAcross / 2) * kMedianStep; }

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
ACMP_HOST_DEVICE inline bool HasSeveralSurfaces(const MedianContext& context, int col, int row) {
  constexpr float kSameSurfaces = 1.05f;
  float nearest = FLT_MAX, farthest = 0;
  const int last_col = context.depth.width - 1, last_row = context.depth.height - 1;
  ACMP_UNROLL
  for (int n = 0; n < kMedianSamples; ++n) {
    const float depth =
        context.depth(Clamped(col + SampleOffsetX(n), last_col), Clamped(row + SampleOffsetY(n), last_row));
    nearest = depth > 0 && depth < nearest ? depth : nearest;
    farthest = depth > farthest ? depth : farthest;
  }
  return farthest > kSameSurfaces * nearest;
}

/// What the sources that look through a sample leave of its weight. One may be wrong itself; the more, the less likely.
ACMP_HOST_DEVICE inline float ShareOfWeight(int looking_through) {
  return 1.0f / static_cast<float>(1 << 2 * looking_through);  // a quarter for each
}

/// Those inside the image with a depth in the range. All are loaded, so that a GPU does not wait for one before it asks
/// for the next.
ACMP_HOST_DEVICE inline void FindMedianSamples(const MedianContext& context, int col, int row, MedianSamples* samples) {
  constexpr float kInverseColorReach = 1 / 15.0f;    // summed over three channels: the weight falls by e
  constexpr float kInverseDistanceReach = 1 / 8.0f;  // px
  const int last_col = context.depth.width - 1, last_row = context.depth.height - 1;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const bool has_color = !context.color.empty();
  const Rgb own = has_color ? context.color(col, row) : Rgb{0, 0, 0};
  ACMP_UNROLL
  for (int n = 0; n < kMedianSamples; ++n) {
    const int dx = SampleOffsetX(n), dy = SampleOffsetY(n);
    const int c = Clamped(col + dx, last_col), r = Clamped(row + dy, last_row);
    const bool is_inside = c == col + dx && r == row + dy;
    const float depth = context.depth(c, r);
    const bool counts = is_inside && depth >= context.depth_min && depth <= context.depth_max;
    const float share = ShareOfWeight(LookingThrough(context.sightings(c, r)));
    const int color = has_color ? ColorDistance(own, context.color(c, r)) : 0;
    const float distance = sqrtf(static_cast<float>(dx * dx + dy * dy));
    const float weight = expf(-(static_cast<float>(color) * kInverseColorReach + distance * kInverseDistanceReach));
    samples->depth[n] = ExtendedDepth(context, context.planes(c, r), ray, depth);
    samples->weight[n] = counts && samples->depth[n] > 0 ? share * weight : 0;
  }
}

/// Index of the nearest sample up to which lies half of the weight or more, or of one that is nearer by less than a
/// thousandth of all depths' range; -1 of none.
ACMP_HOST_DEVICE inline int WeightedMedianOf(const MedianSamples& samples) {
  constexpr int kBisections = 10;
  float nearest = FLT_MAX, farthest = 0, half = 0;
  ACMP_UNROLL
  for (int n = 0; n < kMedianSamples; ++n) {
    const bool counts = samples.weight[n] > 0;
    nearest = counts && samples.depth[n] < nearest ? samples.depth[n] : nearest;
    farthest = counts && samples.depth[n] > farthest ? samples.depth[n] : farthest;
    half += 0.5f * samples.weight[n];
  }
  if (!(half > 0)) return -1;
  // Less than half of the weight lies up to `low`, half or more up to `high`.
  float low = 0.999f * nearest, high = farthest;
  for (int i = 0; i < kBisections; ++i) {
    const float middle = 0.5f * (low + high);
    float up_to = 0;
    ACMP_UNROLL
    for (int n = 0; n < kMedianSamples; ++n) up_to += samples.depth[n] <= middle ? samples.weight[n] : 0;
    (up_to < half ? low : high) = middle;
  }
  int median = -1;
  float depth = FLT_MAX;
  ACMP_UNROLL
  for (int n = 0; n < kMedianSamples; ++n) {
    const bool is_nearer = samples.weight[n] > 0 && samples.depth[n] > low && samples.depth[n] < depth;
    depth = is_nearer ? samples.depth[n] : depth;
    median = is_nearer ? n : median;
  }
  return median;
}

/// The weighted median of the surfaces around: of those of the pixel's colour, and the nearer ones first. Pixels that
/// sources look through have less say. Where the depth changes by more than one in a hundred, the cost is that of
/// another surface: whoever fuses maps has to ask the views again.
ACMP_HOST_DEVICE inline void FilterPixel(const MedianContext& context, int col, int row) {
  constexpr float kSameSurface = 0.01f;
  context.filtered(col, row) = context.planes(col, row);
  if (LookingThrough(context.sightings(col, row)) == 0 && !HasSeveralSurfaces(context, col, row)) return;
  MedianSamples samples;
  FindMedianSamples(context, col, row, &samples);
  const int median = WeightedMedianOf(samples);
  if (median < 0) return;
  const int c = col + SampleOffsetX(median), r = row + SampleOffsetY(median);
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const PlaneHypothesis& plane = context.planes(c, r);
  const float depth = ExtendedDepth(context, plane, ray, context.depth(c, r));
  context.filtered(col, row) = PlaneThrough(plane.normal(), ray, depth);
  const float before = context.depth(col, row);
  if (fabsf(depth - before) <= kSameSurface * before) return;
  float& cost = context.cost(col, row);
  cost = cost < kUnverifiedCost ? kUnverifiedCost : cost;
}

}  // namespace acmp
