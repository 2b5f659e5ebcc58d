#pragma once

#include "acmp_mapping/patch_match/kernel/ncc.h"

namespace acmp {

/// The weighted mean of absolute differences, worst from 64 grey levels on.
struct AbsoluteDifference {
  ACMP_HOST_DEVICE static bool IsInformed(const ReferencePatch& /*patch*/, const PatchMatchOptions& /*options*/) {
    return true;
  }
  ACMP_HOST_DEVICE static void Add(const PatchSample& reference, float center, float gray, WindowSums* sums) {
    sums->ws += reference.weight * fabsf(gray - center - reference.value);
  }
  ACMP_HOST_DEVICE static float Of(const WindowSums& sums, const ReferencePatch& patch,
                                   const PatchMatchOptions& /*options*/) {
    return Clamp(sums.ws * patch.inv_sum_weight / 32, 0.0f, kWorstCost);
  }
};

using MatchingCost = AbsoluteDifference;

}  // namespace acmp
