#pragma once

#include <cfloat>
#include <cmath>

#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {

/// What a pixel of another colour counts for: less, as it is more likely of another surface. A pixel on a small thing
/// in front of a wall is compared with the rest of the thing then, and one of the wall that was given the thing's depth
/// with the wall.
/// @param distance of the colours, ColorDistance; half of the weight is left at 20
ACMP_HOST_DEVICE inline float ColorWeight(int distance) {
  constexpr float kSquaredHalf = 400;
  return kSquaredHalf / (kSquaredHalf + static_cast<float>(distance * distance));
}

/// Calls function(col, row, weight) for the pixels around one of the reference that are inside the image: 24, in 8
/// directions at 4, 8 and 16 px. Their weight is ColorWeight, or 1 without colours.
template <class Function>
ACMP_HOST_DEVICE inline void ForEachAround(const FusionMaps& reference, int col, int row, const Function& function) {
  const bool has_color = !reference.color.empty();
  for (int step = 4; step <= 16; step *= 2) {
    const int diagonal = step * 3 / 4;  // nearly as far: 0.75 sqrt(2) = 1.06
    for (int place = 0; place < 9; ++place) {
      if (place == 4) continue;  // the pixel itself
      const int right = place % 3 - 1, down = place / 3 - 1;
      const int length = right == 0 || down == 0 ? step : diagonal;
      const int c = col + right * length, r = row + down * length;
      if (!reference.depth.Contains(c, r)) continue;
      function(c, r, has_color ? ColorWeight(ColorDistance(reference.color(col, row), reference.color(c, r))) : 1.0f);
    }
  }
}

/// Deviations count up to this: beyond, it is another surface.
constexpr float kMaxUnevenness = 0.1f;

/// Mean relative deviation of depths around a pixel (ForEachAround) from its plane, each at most kMaxUnevenness.
/// Unknown depths do not count; with none, or a plane that does not face the camera, it is kMaxUnevenness. A wrong
/// estimate rarely fits its surroundings: without any view this alone sorts errors better than the number of consistent
/// views does.
ACMP_HOST_DEVICE inline float SurfaceUnevenness(const FusionContext& context, const ReferencePixel& pixel) {
  // The plane's depth is inverse to n . ray, which is negative where the plane faces the camera.
  const RayGrid& rays = context.geometry.rays;
  const Vec3f normal = context.reference.Normal(pixel.col, pixel.row);
  const float facing = Dot(normal, rays.Ray(static_cast<float>(pixel.col), static_cast<float>(pixel.row)));
  if (!(facing < 0)) return kMaxUnevenness;
  const float inverse_offset = 1 / (facing * pixel.depth);
  float sum = 0, weights = 0;
  ForEachAround(context.reference, pixel.col, pixel.row, [&](int col, int row, float weight) {
    const float depth = context.reference.depth(col, row);
    if (!IsKnown(depth)) return;
    const float there = Dot(normal, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
    const float deviation = fabsf(there * depth * inverse_offset - 1);
    sum += weight * (deviation < kMaxUnevenness ? deviation : kMaxUnevenness);
    weights += weight;
  });
  return weights > 0 ? sum / weights : kMaxUnevenness;
}

/// LogOdds without a depth.
constexpr float kUnknownOdds = -FLT_MAX;

/// What the source views say about a reference pixel's point, whatever thresholds fusion uses and whether or not
/// earlier views have used what they see.
struct ViewEvidence {
  int views = 0;             ///< whose image the point falls into
  int silent = 0;            ///< of these, views with no depth of their own there: unknown, or unconfirmed
  float best_agreement = 0;  ///< the greatest GradedAgreement of the others
};

/// How well a source's depth fits the pixel's: exp(-(px + 200 rel)) min(sin(angle / 2) / sin 5 deg, 1), 0..1: between
/// rays that are nearly parallel, agreement says little about depth.
/// @param angle_versine 1 - cos of the angle between the rays, 2 sin^2(angle / 2)
ACMP_HOST_DEVICE inline float GradedAgreement(float reprojection_px, float relative_depth, float angle_versine) {
  constexpr float kPixelsPerRelativeDepth = 200;  // 2 px weigh like 1 % of depth
  constexpr float kNothing = 20;                  // exp(-20) = 2e-9 is not worth its computation
  constexpr float kFullVersine = 1.51922470e-2f;  // of 10 degrees
  const float error = reprojection_px + kPixelsPerRelativeDepth * relative_depth;
  if (!(error < kNothing)) return 0;  // NaN, too
  const float fit = expf(-error);
  return angle_versine < kFullVersine ? fit * sqrtf(angle_versine / kFullVersine) : fit;
}

ACMP_HOST_DEVICE inline ViewEvidence GatherEvidence(const FusionContext& context, const ReferencePixel& pixel) {
  ViewEvidence evidence;
  for (int i = 0; i < context.num_sources; ++i) {
    const FusionSource& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    ++evidence.views;
    ViewAgreement agreement;
    if (source.view.IsUnconfirmed(place.col, place.row) || !ProjectBack(source, true, pixel, place, &agreement)) {
      ++evidence.silent;
      continue;
    }
    const float graded = GradedAgreement(sqrtf(agreement.squared_px), agreement.relative_depth,
                                         TriangulationVersine(pixel, source.geometry.baseline));
    evidence.best_agreement = graded > evidence.best_agreement ? graded : evidence.best_agreement;
  }
  return evidence;
}

/// Logarithm of the odds that a depth is right, which is within 2 % of the true one: a logistic regression, fitted to
/// five recorded and two synthetic scenes (docs/benchmarks.md, "Confidence"). Three numbers say all that was found to
/// be known: matching cost, texture, the number of agreeing views and of those that see through add nothing to them.
/// @param unevenness how far the surface around deviates from the pixel's plane (SurfaceUnevenness)
ACMP_HOST_DEVICE inline float LogOddsOf(const ViewEvidence& evidence, float unevenness) {
  const float silent_share =
      evidence.views > 0 ? static_cast<float>(evidence.silent) / static_cast<float>(evidence.views) : 0;
  return -7.0f - 1.74f * logf(unevenness + 0.01f) + 2.22f * evidence.best_agreement - 1.59f * silent_share;
}

/// LogOddsOf a pixel of the reference by itself. Without a normal nothing speaks for it. An unsupported one has a
/// quarter of the odds: on surfaces they fall by less (exp(-0.33) was fitted), in a sky to nothing.
ACMP_HOST_DEVICE inline float LogOdds(const FusionContext& context, int col, int row) {
  if (!IsKnown(context.reference.depth(col, row))) return kUnknownOdds;
  constexpr float kQuarter = -1.4f;
  ReferencePixel pixel;
  const float log_odds = LoadReferencePixel(context, col, row, &pixel)
                             ? LogOddsOf(GatherEvidence(context, pixel), SurfaceUnevenness(context, pixel))
                             : LogOddsOf({}, kMaxUnevenness);
  return log_odds + (context.reference.IsUnsupported(col, row) ? kQuarter : 0);
}

/// Confidence of a pixel of the reference: the probability that its depth is right, from the mean of the log odds of it
/// and of the surface around it (ForEachAround, depths within 10 %). Where a surface is wrong it is so in patches: what
/// is known of one pixel says much about the next. 0 without depth.
/// @param context with `log_odds` of all pixels
ACMP_HOST_DEVICE inline float ConfidenceOf(const FusionContext& context, int col, int row) {
  constexpr float kSameSurface = 0.1f;
  const float own = context.log_odds(col, row);
  if (own == kUnknownOdds) return 0;
  const float depth = context.reference.depth(col, row);
  float sum = own, weights = 1;
  ForEachAround(context.reference, col, row, [&](int c, int r, float weight) {
    const float odds = context.log_odds(c, r);
    if (odds == kUnknownOdds) return;
    if (!(fabsf(context.reference.depth(c, r) - depth) < kSameSurface * depth)) return;
    sum += weight * odds;
    weights += weight;
  });
  return 1 / (1 + expf(-sum / weights));
}

}  // namespace acmp
