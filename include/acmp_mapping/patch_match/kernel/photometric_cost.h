#pragma once

#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/matching_cost.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// Whether a window, warped into a source, reaches a pixel that the source's mask ignores. The mask distance at its
/// middle is compared with how far it reaches: one look for a whole window. At the same scale windows whose middle is
/// within 6 px of such a pixel do. The middle lies inside the source.
template <class Sampler>
ACMP_HOST_DEVICE inline bool ReachesMasked(const MatchContext<Sampler>& context, int view, const PlaneWarp& warp) {
  constexpr float kInterpolation = 1.5f;  // px, from the pixel nearest to the middle to one that is interpolated
  if (!Sampler::kHasMasks || context.source_mask_distances == nullptr) return false;
  const ImageView<const unsigned char>& mask_distance = context.source_mask_distances[view];
  if (mask_distance.data == nullptr) return false;
  const float min_z = warp.center.z - kPatchRadius * (fabsf(warp.step_col.z) + fabsf(warp.step_row.z));
  if (!(min_z > 0)) return true;
  const float inv_z = Reciprocal(warp.center.z);
  const float x = warp.center.x * inv_z, y = warp.center.y * inv_z;
  // A sample at offset (i, j) is off the middle by (i dx_i + j dx_j) / z in x, with dx_i = step_col.x - x step_col.z.
  const float across = fabsf(warp.step_col.x - x * warp.step_col.z) + fabsf(warp.step_row.x - x * warp.step_row.z);
  const float along = fabsf(warp.step_col.y - y * warp.step_col.z) + fabsf(warp.step_row.y - y * warp.step_row.z);
  const float reach = kPatchRadius * Reciprocal(min_z) * (across > along ? across : along);
  const auto nearest = [](float position, int size) {
    const float clamped = Clamp(position, 0.0f, static_cast<float>(size - 1));
    return static_cast<int>(clamped + 0.5f);  // NOLINT(bugprone-incorrect-roundings): nothing is negative
  };
  return static_cast<float>(mask_distance(nearest(x, mask_distance.width), nearest(y, mask_distance.height))) <
         reach + kInterpolation;
}

/// Bilateral weight of a window sample: exp(-r / (2 s_r^2) - |dI| / (2 s_c^2)), distances not squared.
ACMP_HOST_DEVICE inline float BilateralWeight(float distance_px, float gray_difference, float inv_spatial,
                                              float inv_color) {
  return expf(-distance_px * inv_spatial - fabsf(gray_difference) * inv_color);
}

/// What the sums over a patch's samples give: of the weights, weighted values and weighted squares.
ACMP_HOST_DEVICE inline void SetMoments(float sum_w, float sum_wr, float sum_wrr, ReferencePatch* patch) {
  // An image smaller than the first ring of samples has no window at all.
  patch->inv_sum_weight = sum_w > 0 ? 1.0f / sum_w : 0.0f;
  patch->mean = sum_wr * patch->inv_sum_weight;
  patch->variance = sum_wrr * patch->inv_sum_weight - patch->mean * patch->mean;
}

/// Fills `patch`, which all of the group see when it returns.
/// @param sigma_color of the bilateral weights, grey levels
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline void LoadReferencePatch(const MatchContext<Sampler>& context, int col, int row,
                                                float sigma_color, const Group& group, ReferencePatch* patch) {
  const float inv_spatial = 0.5f / (context.options.sigma_spatial_px * context.options.sigma_spatial_px);
  const float inv_color = 0.5f / (sigma_color * sigma_color);
  const float center = context.sampler.Reference(col, row);
  float sum_w = 0, sum_wr = 0, sum_wrr = 0;
  ForEach(group, kPatchSamples, [&](int i) {
    const int dx = WindowCol(i);
    const int dy = WindowRow(i);
    PatchSample sample = {0, 0};
    if (context.Contains(col + dx, row + dy)) {
      sample.value = context.sampler.Reference(col + dx, row + dy) - center;
      sample.weight =
          BilateralWeight(sqrtf(static_cast<float>(dx * dx + dy * dy)), sample.value, inv_spatial, inv_color);
    }
    patch->samples[i] = sample;
    sum_w += sample.weight;
    sum_wr += sample.weight * sample.value;
    sum_wrr += sample.weight * sample.value * sample.value;
  });
  sum_w = group.Sum(sum_w);
  sum_wr = group.Sum(sum_wr);
  sum_wrr = group.Sum(sum_wrr);
  if (group.Rank() == 0) {
    patch->center = center;
    SetMoments(sum_w, sum_wr, sum_wrr, patch);
  }
  group.Sync();
}

/// Takes the samples that the reference's mask ignores out of a patch that has been loaded.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline void LeaveOutMasked(const MatchContext<Sampler>& context, int col, int row, const Group& group,
                                            ReferencePatch* patch) {
  if (!context.IsNearMasked(col, row, kPatchRadius)) return;
  float sum_w = 0, sum_wr = 0, sum_wrr = 0;
  ForEach(group, kPatchSamples, [&](int i) {
    const int x = col + WindowCol(i), y = row + WindowRow(i);
    PatchSample sample = patch->samples[i];
    if (context.Contains(x, y) && context.IsMasked(x, y)) sample = {0, 0};
    patch->samples[i] = sample;
    sum_w += sample.weight;
    sum_wr += sample.weight * sample.value;
    sum_wrr += sample.weight * sample.value * sample.value;
  });
  sum_w = group.Sum(sum_w);
  sum_wr = group.Sum(sum_wr);
  sum_wrr = group.Sum(sum_wrr);
  if (group.Rank() == 0) SetMoments(sum_w, sum_wr, sum_wrr, patch);
  group.Sync();
}

/// LoadReferencePatch without what the mask ignores.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline void LoadUnmaskedPatch(const MatchContext<Sampler>& context, int col, int row,
                                               float sigma_color, const Group& group, ReferencePatch* patch) {
  LoadReferencePatch(context, col, row, sigma_color, group, patch);
  LeaveOutMasked(context, col, row, group, patch);
}

/// K_ref^-T n / d: with it H_j = A_j - b_j m^T costs nine multiply-adds per view.
template <class Sampler>
ACMP_HOST_DEVICE inline Vec3f PlaneDual(const MatchContext<Sampler>& context, const PlaneHypothesis& plane) {
  const float inv_d = Reciprocal(plane.d);
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

/// The sums of whole windows in one view by one thread alone. Samplers may overload it, and LoadReferencePatch, with
/// something faster that differs in rounding only.
template <class Sampler>
ACMP_HOST_DEVICE inline void SumWindowsOfView(const Sampler& sampler, int view, const PlaneWarp* warps, int count,
                                              const ReferencePatch& patch, WindowSums* sums) {
  for (int n = 0; n < count; ++n) {
    sums[n] = {};
    ForEachWindowSample(sampler, sampler.ImageOf(view), warps[n],
                        [&](int i, float gray) { MatchingCost::Add(patch.samples[i], patch.center, gray, &sums[n]); });
  }
}

/// Whether the window has to be compared: then `warp` says where; else `cost` is the answer. Worst where the plane's
/// point lies behind the source camera or projects outside its image, and where the window reaches what the source's
/// mask ignores.
template <class Sampler>
ACMP_HOST_DEVICE inline bool PrepareWindow(const MatchContext<Sampler>& context, const ReferencePatch& patch,
                                           const Vec3f& dual, int col, int row, int view, PlaneWarp* warp,
                                           float* cost) {
  const SourceView& source = context.sources[view];
  *warp = MakePlaneWarp(source, dual, static_cast<float>(col), static_cast<float>(row));
  *cost = kWorstCost;
  // Depth over the window is affine in the offset: its minimum is at a corner.
  const float min_z = warp->center.z - kPatchRadius * (fabsf(warp->step_col.z) + fabsf(warp->step_row.z));
  if (!(min_z > 0)) return false;
  const float inv_z = Reciprocal(warp->center.z);
  const float x = warp->center.x * inv_z;
  const float y = warp->center.y * inv_z;
  if (!(x >= -0.5f && y >= -0.5f && x < source.width - 0.5f && y < source.height - 0.5f)) return false;
  if (ReachesMasked(context, view, *warp)) return false;
  *cost = kUninformedCost;
  return MatchingCost::IsInformed(patch, context.options);
}

/// Whether the surface of the present estimates bends or breaks (a crease or a depth discontinuity) within the pixel's
/// window: inverse depth is affine on a plane, so that a pixel of one has the mean of any two opposite ones. Compared
/// with four pairs on the window's rim, those that lie in the image and have planes (without one the difference is NaN,
/// which no comparison finds greater). They are of the other colour, which no one writes
/// meanwhile.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline bool IsSurfaceBroken(const MatchContext<Sampler>& context, int col, int row,
                                             const Group& group) {
  const auto inverse_depth = [&](int x, int y) {
    return PlaneInverseDepth(context.planes(x, y), context.rays.Ray(static_cast<float>(x), static_cast<float>(y)));
  };
  constexpr int kPairs = 4;  // (5, 0), (0, 5), (4, 3), (4, -3): at the same distance, and dx + dy is odd
  static_assert(kPatchRadius == 5, "the pairs lie on the rim");
  const float own = inverse_depth(col, row);
  bool broken = false;
  ForEach(group, kPairs, [&](int i) {
    const int dx = i == 0 ? 5 : i == 1 ? 0 : 4;
    const int dy = i == 0 ? 0 : i == 1 ? 5 : i == 2 ? 3 : -3;
    if (!context.Contains(col + dx, row + dy) || !context.Contains(col - dx, row - dy)) return;
    const float bend = inverse_depth(col + dx, row + dy) + inverse_depth(col - dx, row - dy) - 2.0f * own;
    broken = broken || fabsf(bend) > context.options.edge_bend * own;
  });
  return group.Any(broken);
}

}  // namespace acmp
