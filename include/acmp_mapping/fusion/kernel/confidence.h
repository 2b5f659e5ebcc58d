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
ACMP_HOST_DEVICE inline double ColorWeight(int distance) {
  constexpr double kSquaredHalf = 400;
  return kSquaredHalf / (kSquaredHalf + static_cast<double>(distance) * distance);
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
      function(c, r, has_color ? ColorWeight(ColorDistance(reference.color(col, row), reference.color(c, r))) : 1.0);
    }
  }
}

/// Deviations count up to this: beyond, it is another surface.
constexpr double kMaxUnevenness = 0.1;

/// Mean relative deviation of depths around a pixel (ForEachAround) from its plane, each at most kMaxUnevenness.
/// Unknown depths do not count; with none, or a plane that does not face the camera, it is kMaxUnevenness. A wrong
/// estimate rarely fits its surroundings: without any view this alone sorts errors better than the number of consistent
/// views does.
ACMP_HOST_DEVICE inline double SurfaceUnevenness(const FusionContext& context, const ReferencePixel& pixel) {
  // The plane's depth is inverse to m . (u, v, 1), which is negative where the plane faces the camera.
  const double* from_pixel = context.geometry.target_from_pixel.m;
  const Vec3d& n = pixel.normal;
  const Vec3d m = {from_pixel[0] * n.x + from_pixel[3] * n.y + from_pixel[6] * n.z,
                   from_pixel[1] * n.x + from_pixel[4] * n.y + from_pixel[7] * n.z,
                   from_pixel[2] * n.x + from_pixel[5] * n.y + from_pixel[8] * n.z};
  const double here = Dot(m, pixel.homogeneous);  // times the depth
  if (!(here < 0)) return kMaxUnevenness;
  double sum = 0, weights = 0;
  ForEachAround(context.reference, pixel.col, pixel.row, [&](int col, int row, double weight) {
    const float depth = context.reference.depth(col, row);
    if (!IsKnown(depth)) return;
    const double there = Dot(m, Vec3d{static_cast<double>(col), static_cast<double>(row), 1});
    const double deviation = std::fabs(there * depth / here - 1);
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
  int views = 0;              ///< whose image the point falls into
  int silent = 0;             ///< of these, views with no depth of their own there: unknown, or unconfirmed
  double best_agreement = 0;  ///< the greatest GradedAgreement of the others
};

/// How well a source's depth fits the pixel's: exp(-(px + 200 rel)) min(sin(angle / 2) / sin 5 deg, 1), 0..1: between
/// rays that are nearly parallel, agreement says little about depth.
/// @param angle_versine 1 - cos of the angle between the rays, 2 sin^2(angle / 2)
ACMP_HOST_DEVICE inline double GradedAgreement(double reprojection_px, double relative_depth, double angle_versine) {
  constexpr double kPixelsPerRelativeDepth = 200;  // 2 px weigh like 1 % of depth
  constexpr double kNothing = 20;                  // exp(-20) = 2e-9 is not worth its computation
  constexpr double kFullVersine = 1.51922470e-2;   // of 10 degrees
  const double error = reprojection_px + kPixelsPerRelativeDepth * relative_depth;
  if (!(error < kNothing)) return 0;  // NaN, too
  const double fit = std::exp(-error);
  return angle_versine < kFullVersine ? fit * std::sqrt(angle_versine > 0 ? angle_versine / kFullVersine : 0) : fit;
}

ACMP_HOST_DEVICE inline ViewEvidence GatherEvidence(const FusionContext& context, const ReferencePixel& pixel) {
  ViewEvidence evidence;
  for (int i = 0; i < context.num_sources; ++i) {
    const FusionSource& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    ++evidence.views;
    ViewAgreement agreement;
    if (source.view.IsUnconfirmed(place.col, place.row) ||
        !ProjectBack(source, context.limits, pixel, place, &agreement)) {
      ++evidence.silent;
      continue;
    }
    const double graded = GradedAgreement(std::sqrt(agreement.squared_px), agreement.relative_depth,
                                          TriangulationVersine(pixel, source.geometry.center));
    evidence.best_agreement = graded > evidence.best_agreement ? graded : evidence.best_agreement;
  }
  return evidence;
}

/// Logarithm of the odds that a depth is right, which is within 2 % of the true one: a logistic regression, fitted to
/// five recorded and two synthetic scenes (docs/benchmarks.md, "Confidence"). Three numbers say all that was found to
/// be known: matching cost, texture, the number of agreeing views and of those that see through add nothing to them.
/// @param unevenness how far the surface around deviates from the pixel's plane (SurfaceUnevenness)
ACMP_HOST_DEVICE inline double LogOddsOf(const ViewEvidence& evidence, double unevenness) {
  const double silent_share = evidence.views > 0 ? static_cast<double>(evidence.silent) / evidence.views : 0.0;
  return -7.0 - 1.74 * std::log(unevenness + 0.01) + 2.22 * evidence.best_agreement - 1.59 * silent_share;
}

/// LogOddsOf a pixel of the reference by itself. Without a normal nothing speaks for it. An unsupported one has a
/// quarter of the odds: on surfaces they fall by less (exp(-0.33) was fitted), in a sky to nothing.
ACMP_HOST_DEVICE inline float LogOdds(const FusionContext& context, int col, int row) {
  if (!IsKnown(context.reference.depth(col, row))) return kUnknownOdds;
  constexpr double kQuarter = -1.4;
  ReferencePixel pixel;
  const double log_odds = LoadReferencePixel(context, col, row, &pixel)
                              ? LogOddsOf(GatherEvidence(context, pixel), SurfaceUnevenness(context, pixel))
                              : LogOddsOf({}, kMaxUnevenness);
  return static_cast<float>(log_odds + (context.reference.IsUnsupported(col, row) ? kQuarter : 0));
}

/// Confidence of a pixel of the reference: the probability that its depth is right, from the mean of the log odds of it
/// and of the surface around it (ForEachAround, depths within 10 %). Where a surface is wrong it is so in patches: what
/// is known of one pixel says much about the next. 0 without depth.
/// @param context with `log_odds` of all pixels
ACMP_HOST_DEVICE inline double ConfidenceOf(const FusionContext& context, int col, int row) {
  constexpr float kSameSurface = 0.1f;
  const float own = context.log_odds(col, row);
  if (own == kUnknownOdds) return 0;
  const float depth = context.reference.depth(col, row);
  double sum = own, weights = 1;
  ForEachAround(context.reference, col, row, [&](int c, int r, double weight) {
    const float odds = context.log_odds(c, r);
    if (odds == kUnknownOdds) return;
    if (!(std::fabs(context.reference.depth(c, r) - depth) < kSameSurface * depth)) return;
    sum += weight * odds;
    weights += weight;
  });
  return 1 / (1 + std::exp(-sum / weights));
}

}  // namespace acmp
