#pragma once

#include <cmath>

#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// What the source views say about a reference pixel's point, whatever thresholds fusion uses.
struct ViewEvidence {
  int views = 0;          ///< whose image the point falls into
  double agreement = 0;   ///< sum of GradedAgreement over those with a depth of their own there
  int contradicting = 0;  ///< of these, views that see something clearly farther away: they look through the point
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

/// The relative depth error to expect of a pixel from its matching cost (see CostMap), the views, and its unevenness:
/// how far the surface around it deviates from its plane (see SurfaceUnevenness, 0..0.1). Fitted to the logarithm of
/// true errors of holo_table and holo_cabinet before unevenness weighed colours; docs/experiments.md says what each
/// term is worth. It never falls when cost, unevenness or the share of contradicting views grows or the mean agreement
/// falls. A NaN cost is no photometric evidence, kUnsupportedCost evidence against the depth; without views only cost
/// and unevenness count. Completed pixels (kUnverifiedCost, kWorstCost) have no photometric evidence.
ACMP_HOST_DEVICE inline double ExpectedRelativeError(float cost, const ViewEvidence& evidence, double unevenness) {
  constexpr double kUnsupportedExponent = 1.4;  // four times the error
  const double used_cost = cost > 0 ? cost : 0;
  // The paper's photometric likelihood (eq. 5).
  const double photometric = cost != cost ? 0.0 : std::exp(-used_cost * used_cost / 0.18);
  const double share = evidence.views > 0 ? 1.0 / evidence.views : 0.0;
  const double unsupported = cost >= kUnsupportedCost ? kUnsupportedExponent : 0.0;
  const double exponent =
      2.0 * share * evidence.contradicting - 0.9 * share * evidence.agreement - 0.3 * photometric + unsupported;
  return 0.5 * std::pow(unevenness + 0.01, 0.9) * std::exp(exponent);
}

/// Confidence 0..1: 1 / (1 + expected error / 1 %), so one half where an error of 1 % of depth is expected.
/// @param error relative
ACMP_HOST_DEVICE inline double ConfidenceOfError(double error) { return 1 / (1 + 100 * error); }

}  // namespace acmp
