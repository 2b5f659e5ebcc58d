#pragma once

#include <cstring>
#include <type_traits>

#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "cuda_resources.h"
#include "patch_match_kernels.h"
#include "warp_group.h"

namespace acmp {

/// Threads per pixel, as many as there are candidates: each prepares the comparison of one hypothesis in one view, and
/// four of them make it together. Fewer registers per thread than one thread per pixel leave room for the threads that
/// hide the textures' latency, and their four fetches side by side run at full speed even where neighbouring pixels'
/// hypotheses lie far apart.
constexpr int kGroupSize = 8;
constexpr int kGroupCols = 8;  ///< groups of a block, along and across the rows
constexpr int kGroupRows = 2;
constexpr int kBlockThreads = kGroupSize * kGroupCols * kGroupRows;
/// Threads in flight per multiprocessor against registers per thread (80): on an H200 5 and 8 are slower by 5 to 7 %.
constexpr int kBlocksPerMultiprocessor = 6;

/// The threads of one pixel.
struct PixelThreads : WarpGroup<kGroupSize> {
  static constexpr int kWindowThreads = 4;
  __device__ float SumOverWindow(float value) const { return WarpGroup<kWindowThreads>::Sum(value); }
};

/// Words of shared memory per group. The four groups of a warp read the same part of their patches at once: eight words
/// apart, 16-byte reads of them fall into different banks.
inline int ScratchWords(int num_sources) {
  const int words = static_cast<int>(sizeof(PixelScratch) / sizeof(float)) + PixelScratch::kWordsPerView * num_sources;
  return (words + 23) / 32 * 32 + 8;
}

/// Pixel and scratch of the calling thread's group.
struct GroupPlace {
  int col, row;  ///< among the groups of the grid
  PixelScratch* scratch;
};

__device__ inline GroupPlace PlaceOfGroup(int scratch_words) {
  extern __shared__ __align__(16) float scratch[];
  const int group = static_cast<int>(threadIdx.x) / kGroupSize;
  return {static_cast<int>(blockIdx.x) * kGroupCols + group % kGroupCols,
          static_cast<int>(blockIdx.y) * kGroupRows + group / kGroupCols,
          reinterpret_cast<PixelScratch*>(scratch + group * scratch_words)};
}

/// Column of a group's pixel: groups of a row cover the pixels of one colour, every second column.
__device__ inline int ColOfGroup(const GroupPlace& place, int color) {
  return 2 * place.col + ((place.row + color) & 1);
}

/// The context for the kernels that know masks.
inline MatchContext<MaskedTextureSampler> WithMasks(const CudaMatchContext& context) {
  MatchContext<MaskedTextureSampler> masked;
  static_assert(sizeof(masked) == sizeof(context), "the samplers differ in a constant only");
  static_assert(std::is_trivially_copyable<CudaMatchContext>::value, "copied byte by byte");
  std::memcpy(static_cast<void*>(&masked), &context, sizeof(masked));
  return masked;
}

template <Pass kPass, Method kMethod, class Sampler>
__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    UpdateKernel(const __grid_constant__ MatchContext<Sampler> context, int scratch_words, int color, int iteration) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  const int col = ColOfGroup(place, color);
  if (col >= context.width || place.row >= context.height) return;
  UpdatePixel<kPass, kMethod>(context, col, place.row, iteration, PixelThreads(), place.scratch);
}

inline int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

/// Grid and shared memory of kernels that have a group for every pixel of one colour.
struct GroupGrid {
  template <class Sampler>
  explicit GroupGrid(const MatchContext<Sampler>& context)
      : scratch_words(ScratchWords(context.num_sources)),
        bytes(static_cast<size_t>(scratch_words) * kGroupCols * kGroupRows * sizeof(float)),
        blocks(DivideUp(DivideUp(context.width, 2), kGroupCols), DivideUp(context.height, kGroupRows)) {}

  int scratch_words;
  size_t bytes;
  dim3 blocks;
};

/// Queues the checkerboard iterations of a pass.
template <Pass kPass, Method kMethod, class Sampler>
void LaunchIterations(const MatchContext<Sampler>& context, const GroupGrid& grid, int iterations,
                      cudaStream_t stream) {
  for (int iteration = 0; iteration < iterations; ++iteration) {
    for (int color = 0; color < 2; ++color) {
      UpdateKernel<kPass, kMethod>
          <<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, grid.scratch_words, color, iteration);
      CudaCheck(cudaGetLastError(), "launch update");
    }
  }
}

}  // namespace acmp
