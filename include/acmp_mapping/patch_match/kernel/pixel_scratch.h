#pragma once

#include <cstddef>

#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"

namespace acmp {

constexpr int kMaxHypotheses = kNumRegions + 1;  ///< of one step: the candidates and the pixel's own

/// A window that waits for comparison; image < 0: none.
struct alignas(16) WindowTask {
  PlaneWarp warp;
  int image;  ///< as the sampler calls it
};

/// The largest group; the CPU's has one member.
constexpr int kMaxGroupSize = 8;

/// What the group of one pixel shares. The arrays per source view lie behind it, so that few views need little memory.
struct PixelScratch {
  ReferencePatch patch;
  WindowTask tasks[kMaxGroupSize];
  PlaneHypothesis planes[kMaxHypotheses];
  float cost[kMaxHypotheses];    ///< what is stored of each plane: photometric, or eq. 13
  float energy[kMaxHypotheses];  ///< what is compared: eq. 1, 7 or 13
  float limit[kMaxHypotheses];   ///< weighted sum of view costs from which on a plane cannot win
  int alive[kMaxHypotheses];     ///< planes whose sum is still below their limit
  int count;                     ///< of the planes, or of those alive
  int num_sources;

  ACMP_HOST_DEVICE float* Arrays() { return reinterpret_cast<float*>(this + 1); }
  /// Cost of each plane in each view: [kMaxHypotheses][num_sources].
  ACMP_HOST_DEVICE float* ViewCost(int hypothesis) { return Arrays() + hypothesis * num_sources; }
  ACMP_HOST_DEVICE float* ViewProbability() { return ViewCost(kMaxHypotheses); }
  /// How often each view was drawn.
  ACMP_HOST_DEVICE int* Draws() { return reinterpret_cast<int*>(ViewProbability() + num_sources); }
  /// The views that were drawn at least once, the most often drawn first.
  ACMP_HOST_DEVICE int* DrawnViews() { return Draws() + num_sources; }

  static constexpr int kWordsPerView = kMaxHypotheses + 3;
};

/// Scratch of one pixel on the stack: for groups of one.
struct StackScratch {
  PixelScratch shared;
  float arrays[PixelScratch::kWordsPerView * kMaxSourceViews];
};
static_assert(offsetof(StackScratch, arrays) == sizeof(PixelScratch), "the arrays follow without a gap");

}  // namespace acmp
