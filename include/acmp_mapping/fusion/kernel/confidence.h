#pragma once

#include <cmath>

#include "acmp_mapping/common/vector_math.h"

namespace acmp {

/// Confidence 0..1 of a pixel from its matching cost (0..2), the number of consistent source views and their median
/// triangulation angle: C = 0.2 P + 0.5 S + 0.3 P S with
///   P = exp(-cost^2 / 0.18), the paper's photometric likelihood (eq. 5), and
///   S = 1 - 2^(-n min(angle / 10 deg, 1)): each of the n consistent views halves the remaining doubt, less so if rays
///       to the point are nearly parallel, when agreement says little about depth.
/// All coefficients are positive, so C never falls when the cost falls or n or the angle grows. Without a consistent
/// view C <= 0.2; two views at 10 degrees give 0.375 to 0.8. A NaN cost counts as no photometric evidence.
ACMP_HOST_DEVICE inline float ComputeConfidence(float cost, int consistent_views, float angle_deg) {
  const double used_cost = cost > 0 ? cost : 0;
  const double photometric = cost != cost ? 0.0 : std::exp(-used_cost * used_cost / 0.18);
  const double evidence = consistent_views > 0 ? consistent_views * Clamp(angle_deg / 10, 0.0f, 1.0f) : 0;
  const double support = 1 - std::exp2(-evidence);
  return static_cast<float>(0.2 * photometric + 0.5 * support + 0.3 * photometric * support);
}

/// The angle (rad) whose 1 - cos, which is 2 sin^2(angle / 2), is given.
ACMP_HOST_DEVICE inline double AngleOfVersine(float versine) {
  return 2 * std::asin(std::sqrt(static_cast<double>(Clamp(0.5f * versine, 0.0f, 1.0f))));
}

/// Median in rad of the angles with these versines, which get sorted; of an even number the mean of the middle two, of
/// none 0.
ACMP_HOST_DEVICE inline double MedianAngle(float* versines, int count) {
  if (count == 0) return 0;
  // By insertion: there are few. Versines are in the order of their angles, so only the middle ones become angles.
  for (int i = 1; i < count; ++i) {
    const float versine = versines[i];
    int k = i;
    for (; k > 0 && versines[k - 1] > versine; --k) versines[k] = versines[k - 1];
    versines[k] = versine;
  }
  const double lower = AngleOfVersine(versines[(count - 1) / 2]);
  return count % 2 == 1 ? lower : 0.5 * (lower + AngleOfVersine(versines[count / 2]));
}

}  // namespace acmp
