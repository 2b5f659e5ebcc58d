#pragma once

#include <cfloat>
#include <cmath>

#include "acmp_mapping/fusion/kernel/surface_unevenness.h"

namespace acmp {

/// LogExpectedError without a depth.
constexpr float kUnknownError = FLT_MAX;

/// What all sources say about a pixel, whether or not earlier views have used what they see.
template <class View>
ACMP_HOST_DEVICE inline ViewEvidence GatherEvidence(const FusionContext<View>& context, const ReferencePixel& pixel) {
  ViewEvidence evidence;
  for (int i = 0; i < context.num_sources; ++i) {
    const FusionSource<View>& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    ++evidence.views;
    ViewAgreement agreement;
    if (ProjectBack(source, pixel, place, &agreement)) AddEvidence(source, pixel, agreement, &evidence);
  }
  return evidence;
}

/// Natural logarithm of the relative error to expect of a pixel of the reference by itself. Without a normal nothing
/// but its cost is known.
template <class View>
ACMP_HOST_DEVICE inline float LogExpectedError(const FusionContext<View>& context, int col, int row) {
  if (!IsKnown(context.reference.Depth(col, row))) return kUnknownError;
  const float cost = context.reference.Cost(col, row);
  ReferencePixel pixel;
  const double error =
      LoadReferencePixel(context, col, row, &pixel)
          ? ExpectedRelativeError(cost, GatherEvidence(context, pixel), SurfaceUnevenness(context, pixel))
          : ExpectedRelativeError(cost, {}, kMaxUnevenness);
  return static_cast<float>(std::log(error));
}

/// Confidence of a pixel of the reference: of the geometric mean of the errors to expect of it and of the surface
/// around it (ForEachAround, depths within 10 %). Where a surface is wrong it is so in patches: what is expected of one
/// pixel says much about the next, and more pixels say more. 0 without depth.
/// @param context with `log_error` of all pixels
template <class View>
ACMP_HOST_DEVICE inline double ConfidenceOf(const FusionContext<View>& context, int col, int row) {
  constexpr float kSameSurface = 0.1f;
  const float own = context.log_error(col, row);
  if (own == kUnknownError) return 0;
  const float depth = context.reference.Depth(col, row);
  double sum = own, weights = 1;
  ForEachAround(context.reference, col, row, [&](int c, int r, double weight) {
    const float error = context.log_error(c, r);
    if (error == kUnknownError) return;
    if (!(std::fabs(context.reference.Depth(c, r) - depth) < kSameSurface * depth)) return;
    sum += weight * error;
    weights += weight;
  });
  return ConfidenceOfError(std::exp(sum / weights));
}

}  // namespace acmp
