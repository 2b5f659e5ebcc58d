#pragma once

#include <type_traits>
#include <vector>

#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// What costs most on a CPU, several samples at a time by the instructions of one set. All sets give the same bits.
struct HostFunctions {
  const char* instructions;
  int lanes;  ///< of a register
  /// Ncc's sums of each of `count` windows in one image, of at least 2 x 2 px.
  void (*sum_windows)(const ImageView<const float>& image, const PlaneWarp* warps, int count,
                      const ReferencePatch& patch, WindowSums* sums);
  /// LoadReferencePatch, with the factors of BilateralWeight.
  void (*load_patch)(const ImageView<const float>& reference, int col, int row, float inv_spatial, float inv_color,
                     ReferencePatch* patch);
  /// MedianFilterPixel for `lanes` pixels, every second one of a row from (col, row) on: the same bits. All must be at
  /// least kMedianReach from the image's border and from what its mask ignores.
  void (*filter_medians)(const RayGrid& rays, float depth_min, float depth_max, int col, int row,
                         const ImageView<PlaneHypothesis>& planes);
  /// FindConfidences. Also reads, but takes no notice of, costs of views that are not in the mask, and what follows the
  /// last hypothesis' costs up to a register's size.
  void (*find_confidences)(const float* costs, uint32_t views, int num_views, int count, const ConfidenceRule& rule,
                           float* confidence);
};

/// For every instruction set that this machine has, the fastest last. Programs are built for the oldest processors, so
/// the choice is made when they run.
std::vector<HostFunctions> SupportedHostFunctions();

/// BestOfRegion of the near regions or the far ones, in all four directions at once: they must lie in the image.
/// @param cost of the pixel, in rows `stride` apart
void FindBestOfRegions(const float* cost, int stride, bool is_far, int (&best)[kDirections]);

/// The CPU's sampler.
struct CpuSampler : BilinearSampler {
  HostFunctions host;
};

/// Whether `sum_windows` reads the image.
inline bool CanSumWindows(const ImageView<const float>& image) { return image.width >= 2 && image.height >= 2; }

inline void SumWindowsOfView(const CpuSampler& sampler, int view, const PlaneWarp* warps, int count,
                             const ReferencePatch& patch, WindowSums* sums) {
  if (std::is_same_v<MatchingCost, Ncc> && CanSumWindows(sampler.sources[view])) {
    sampler.host.sum_windows(sampler.sources[view], warps, count, patch, sums);
  } else {
    SumWindowsOfView<BilinearSampler>(sampler, view, warps, count, patch, sums);
  }
}

template <bool kMasked>
WindowSums SumPlainWindow(const CpuSampler& sampler, int view, const PlaneWarp& warp,
                          const PlainWindow<kMasked>& window) {
  if (!window.is_whole || !CanSumWindows(sampler.sources[view])) {
    return SumPlainWindow<kMasked, BilinearSampler>(sampler, view, warp, window);
  }
  PlaneWarp own = warp;
  own.center = window.pixel_col * warp.step_col + window.pixel_row * warp.step_row + warp.center;
  WindowSums sums;
  sampler.host.sum_windows(sampler.sources[view], &own, 1, window.patch, &sums);
  return sums;
}

inline void LoadReferencePatch(const MatchContext<CpuSampler>& context, int col, int row, float sigma_color,
                               const SingleThread&, ReferencePatch* patch) {
  const float inv_spatial = 0.5f / (context.options.sigma_spatial_px * context.options.sigma_spatial_px);
  const float inv_color = 0.5f / (sigma_color * sigma_color);
  context.sampler.host.load_patch(context.sampler.reference, col, row, inv_spatial, inv_color, patch);
}

inline void FindConfidences(const CpuSampler& sampler, const SingleThread&, const float* costs, uint32_t views,
                            int num_views, int count, const ConfidenceRule& rule, float* confidence) {
  sampler.host.find_confidences(costs, views, num_views, count, rule, confidence);
}

inline int CollectCandidates(const MatchContext<CpuSampler>& context, int col, int row, const Vec3f& ray,
                             const RegionRange& regions, const SingleThread& group, PlaneHypothesis* candidates,
                             int* count) {
  for (int first = 0; first < regions.count; first += kDirections) {
    const bool is_far = regions.first + first >= kDirections;
    const int reach = RegionReach(is_far);
    const bool is_inside = context.Contains(col - reach, row - reach) && context.Contains(col + reach, row + reach);
    int best[kDirections];
    if (is_inside) FindBestOfRegions(&context.cost(col, row), context.cost.stride, is_far, best);
    for (int i = 0; i < kDirections; ++i) {
      const int region = regions.first + first + i;
      const int member = is_inside ? best[i] : BestOfRegion(context, col, row, region);
      candidates[first + i] = CandidateOf(context, col, row, ray, region, member);
    }
  }
  return RemoveAbsent(group, regions.count, candidates, count);
}

}  // namespace acmp
