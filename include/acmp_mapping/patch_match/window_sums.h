#pragma once

#include <vector>

#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// What costs most on a CPU, several samples at a time by the instructions of one set. All sets give the same bits.
struct WindowFunctions {
  const char* instructions;
  /// As the function of that name, from an image of at least 2 x 2 px.
  WindowSums (*sum_window)(const ImageView<const float>& image, const PlaneWarp& warp, const ReferencePatch& patch);
  /// LoadReferencePatch, with the factors of BilateralWeight.
  void (*load_patch)(const ImageView<const float>& reference, int col, int row, float inv_spatial, float inv_color,
                     ReferencePatch* patch);
};

/// For every instruction set that this machine has, the fastest last. Programs are built for the oldest processors, so
/// the choice is made when they run.
std::vector<WindowFunctions> SupportedWindowFunctions();

/// The CPU's sampler.
struct CpuSampler : BilinearSampler {
  WindowFunctions window;
};

inline WindowSums SumWindow(const CpuSampler& sampler, int view, const PlaneWarp& warp, const ReferencePatch& patch) {
  const ImageView<const float>& image = sampler.sources[view];
  if (image.width < 2 || image.height < 2) return SumWindow<BilinearSampler>(sampler, view, warp, patch);
  return sampler.window.sum_window(image, warp, patch);
}

inline void LoadReferencePatch(const MatchContext<CpuSampler>& context, int col, int row, float sigma_color,
                               const SingleThread&, ReferencePatch* patch) {
  const float inv_spatial = 0.5f / (context.options.sigma_spatial_px * context.options.sigma_spatial_px);
  const float inv_color = 0.5f / (sigma_color * sigma_color);
  context.sampler.window.load_patch(context.sampler.reference, col, row, inv_spatial, inv_color, patch);
}

}  // namespace acmp
