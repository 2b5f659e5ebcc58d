#pragma once

#include "acmp_mapping/patch_match/kernel/window.h"
#include "acmp_mapping/patch_match/patch_match_options.h"

namespace acmp {

struct PatchSample {
  float value;   ///< grey value minus the patch's center
  float weight;  ///< bilateral; 0 outside the image and where the mask ignores it
};

/// The reference side of the NCC: depends on the pixel only, so one patch serves all hypotheses and views.
struct ReferencePatch {
  alignas(16) PatchSample samples[kPatchSamples];
  float center;  ///< subtracted before summing, or float32 cancellation would give flat windows a texture
  float inv_sum_weight;
  float mean;
  float variance;  ///< grey levels^2
};

/// What a cost adds up over a window's samples, each sum as it likes; the names are Ncc's, with s the source's and r
/// the reference's values.
struct WindowSums {
  float ws = 0, wss = 0, wrs = 0;
};

/// The matching cost m_ij: 1 - NCC, bilaterally weighted.
struct Ncc {
  /// False where the reference's window has no texture to compare.
  ACMP_HOST_DEVICE static bool IsInformed(const ReferencePatch& patch, const PatchMatchOptions& options) {
    return patch.variance >= options.min_variance;
  }
  ACMP_HOST_DEVICE static void Add(const PatchSample& reference, float center, float gray, WindowSums* sums) {
    const float value = gray - center;
    const float weighted = reference.weight * value;
    sums->ws += weighted;
    sums->wss += weighted * value;
    sums->wrs += weighted * reference.value;
  }
  /// 0..2; worst where the source window is flat although the reference's is not.
  ACMP_HOST_DEVICE static float Of(const WindowSums& sums, const ReferencePatch& patch,
                                   const PatchMatchOptions& options) {
    const float mean = sums.ws * patch.inv_sum_weight;
    const float variance = sums.wss * patch.inv_sum_weight - mean * mean;
    if (!(variance >= options.min_variance)) return kWorstCost;
    const float covariance = sums.wrs * patch.inv_sum_weight - patch.mean * mean;
    return Clamp(1.0f - covariance * ReciprocalSqrt(patch.variance * variance), 0.0f, kWorstCost);
  }
};

}  // namespace acmp
