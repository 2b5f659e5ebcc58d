#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// The reference side of the NCC: depends on the pixel only, so one patch serves all hypotheses and views.
struct ReferencePatch {
  float value[kPatchSamples];   ///< grey value minus `center`
  float weight[kPatchSamples];  ///< bilateral; 0 outside the image
  float center;  ///< subtracted before summing, or float32 cancellation would give flat windows a texture
  float inv_sum_weight;
  float mean;
  float variance;  ///< grey levels^2
};

/// Bilateral weight of a window sample: exp(-r / (2 s_r^2) - |dI| / (2 s_c^2)), distances not squared.
ACMP_HOST_DEVICE inline float BilateralWeight(float distance_px, float gray_difference, float inv_spatial,
                                              float inv_color) {
  return expf(-distance_px * inv_spatial - fabsf(gray_difference) * inv_color);
}

template <class Sampler>
ACMP_HOST_DEVICE inline ReferencePatch LoadReferencePatch(const MatchContext<Sampler>& context, int col, int row) {
  const float inv_spatial = 0.5f / (context.options.sigma_spatial_px * context.options.sigma_spatial_px);
  const float inv_color = 0.5f / (context.options.sigma_color * context.options.sigma_color);
  ReferencePatch patch;
  patch.center = context.sampler.Reference(col, row);
  float sum_w = 0, sum_wr = 0, sum_wrr = 0;
  ACMP_UNROLL
  for (int i = 0; i < kPatchSamples; ++i) {
    const int dx = WindowCol(i);
    const int dy = WindowRow(i);
    float value = 0, weight = 0;
    if (context.Contains(col + dx, row + dy)) {
      value = context.sampler.Reference(col + dx, row + dy) - patch.center;
      weight = BilateralWeight(sqrtf(static_cast<float>(dx * dx + dy * dy)), value, inv_spatial, inv_color);
    }
    patch.value[i] = value;
    patch.weight[i] = weight;
    sum_w += weight;
    sum_wr += weight * value;
    sum_wrr += weight * value * value;
  }
  // An image smaller than the first ring of samples has no window at all.
  patch.inv_sum_weight = sum_w > 0 ? 1.0f / sum_w : 0.0f;
  patch.mean = sum_wr * patch.inv_sum_weight;
  patch.variance = sum_wrr * patch.inv_sum_weight - patch.mean * patch.mean;
  return patch;
}

/// K_ref^-T n / d: with it H_j = A_j - b_j m^T costs nine multiply-adds per view.
template <class Sampler>
ACMP_HOST_DEVICE inline Vec3f PlaneDual(const MatchContext<Sampler>& context, const PlaneHypothesis& plane) {
  const float inv_d = 1.0f / plane.d;
  const float x = plane.nx * context.rays.inv_fx * inv_d;
  const float y = plane.ny * context.rays.inv_fy * inv_d;
  return {x, y, plane.nz * inv_d - x * context.rays.cx - y * context.rays.cy};
}

ACMP_HOST_DEVICE inline PlaneWarp MakePlaneWarp(const SourceView& source, const Vec3f& dual, float col, float row) {
  const Mat3f& a = source.a;
  const Vec3f& b = source.b;
  PlaneWarp warp;
  warp.step_col = {a.m[0] - b.x * dual.x, a.m[3] - b.y * dual.x, a.m[6] - b.z * dual.x};
  warp.step_row = {a.m[1] - b.x * dual.y, a.m[4] - b.y * dual.y, a.m[7] - b.z * dual.y};
  const Vec3f constant = {a.m[2] - b.x * dual.z, a.m[5] - b.y * dual.z, a.m[8] - b.z * dual.z};
  warp.center = col * warp.step_col + row * warp.step_row + constant;
  return warp;
}

/// m_ij: 1 - bilateral weighted NCC, in 0..2. Worst where the plane's point lies behind the source camera or projects
/// outside its image, or the source window is flat although the reference's is not.
template <class Sampler>
ACMP_HOST_DEVICE inline float PhotometricCost(const MatchContext<Sampler>& context, const ReferencePatch& patch,
                                              const Vec3f& dual, int col, int row, int view) {
  const SourceView& source = context.sources[view];
  const PlaneWarp warp = MakePlaneWarp(source, dual, static_cast<float>(col), static_cast<float>(row));
  // Depth over the window is affine in the offset: its minimum is at a corner.
  const float min_z = warp.center.z - kPatchRadius * (fabsf(warp.step_col.z) + fabsf(warp.step_row.z));
  if (!(min_z > 0)) return kWorstCost;
  const float inv_z = 1.0f / warp.center.z;
  const float x = warp.center.x * inv_z;
  const float y = warp.center.y * inv_z;
  if (!(x >= -0.5f && y >= -0.5f && x < source.width - 0.5f && y < source.height - 0.5f)) return kWorstCost;
  if (!(patch.variance >= context.options.min_variance)) return kUninformedCost;

  float sum_ws = 0, sum_wss = 0, sum_wrs = 0;
  ForEachWindowSample(context.sampler, view, warp, [&](int i, float gray) {
    const float value = gray - patch.center;
    const float weighted = patch.weight[i] * value;
    sum_ws += weighted;
    sum_wss += weighted * value;
    sum_wrs += weighted * patch.value[i];
  });
  const float mean = sum_ws * patch.inv_sum_weight;
  const float variance = sum_wss * patch.inv_sum_weight - mean * mean;
  if (!(variance >= context.options.min_variance)) return kWorstCost;
  const float covariance = sum_wrs * patch.inv_sum_weight - patch.mean * mean;
  return Clamp(1.0f - covariance / sqrtf(patch.variance * variance), 0.0f, kWorstCost);
}

}  // namespace acmp
