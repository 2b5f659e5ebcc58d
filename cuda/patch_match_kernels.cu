#include <cstring>
#include <type_traits>

#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "kernels.h"
#include "launch.h"

namespace acmp {
namespace {

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
int ScratchWords(int num_sources) {
  const int words = static_cast<int>(sizeof(PixelScratch) / sizeof(float)) + PixelScratch::kWordsPerView * num_sources;
  return (words + 23) / 32 * 32 + 8;
}

/// Pixel and scratch of the calling thread's group.
struct GroupPlace {
  int col, row;  ///< among the groups of the grid
  PixelScratch* scratch;
};

__device__ GroupPlace PlaceOfGroup(int scratch_words) {
  extern __shared__ __align__(16) float scratch[];
  const int group = static_cast<int>(threadIdx.x) / kGroupSize;
  return {static_cast<int>(blockIdx.x) * kGroupCols + group % kGroupCols,
          static_cast<int>(blockIdx.y) * kGroupRows + group / kGroupCols,
          reinterpret_cast<PixelScratch*>(scratch + group * scratch_words)};
}

/// Column of a group's pixel: groups of a row cover the pixels of one colour, every second column.
__device__ int ColOfGroup(const GroupPlace& place, int color) { return 2 * place.col + ((place.row + color) & 1); }

/// The context for the kernels that know masks.
MatchContext<MaskedTextureSampler> WithMasks(const CudaMatchContext& context) {
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

/// A group for two pixels side by side: one of the colour that is updated second, and one that needs no comparison.
template <Pass kPass, class Sampler>
__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    InitializeKernel(const __grid_constant__ MatchContext<Sampler> context, int scratch_words) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  if (place.row >= context.height) return;
  const PixelThreads group;
  const int unmatched_col = ColOfGroup(place, 0), col = ColOfGroup(place, 1);
  if (group.Rank() == 0 && unmatched_col < context.width) InitializeUnmatched<kPass>(context, unmatched_col, place.row);
  if (col < context.width) InitializePixel<kPass>(context, col, place.row, group, place.scratch);
}

template <class Sampler>
__global__ void __launch_bounds__(kBlockWidth* kBlockHeight)
    FilterKernel(const __grid_constant__ MatchContext<Sampler> context, int color) {
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  const int col = 2 * static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x) + ((row + color) & 1);
  if (col < context.width && row < context.height) MedianFilterPixel(context, col, row);
}

/// Threads that share a cell: one per plane, so that those of a quad read the same image.
using CellThreads = WarpGroup<8>;
constexpr int kEvidenceThreads = 128;

template <class Sampler>
__global__ void __launch_bounds__(kEvidenceThreads)
    MeasureEvidenceKernel(const __grid_constant__ MatchContext<Sampler> context, int cell_size,
                          ImageView<float> evidence) {
  const int col = static_cast<int>(blockIdx.x * kEvidenceThreads + threadIdx.x) / CellThreads::kSize;
  const int row = static_cast<int>(blockIdx.y);
  if (col >= evidence.width) return;
  const CellThreads group;
  const float of_cell = EvidenceOfCell(context, col, row, cell_size, group);
  if (group.Rank() == 0) evidence(col, row) = of_cell;
}

/// Of the papers' passes, with one kind of kernels for images with and without masks: these are for comparison.
template <Pass kPass, Method kMethod>
__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    InitializeOfPapersKernel(const __grid_constant__ MatchContext<MaskedTextureSampler> context, int scratch_words,
                             int color) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  const int col = ColOfGroup(place, color);
  if (col >= context.width || place.row >= context.height) return;
  InitializePixel<kPass, kMethod>(context, col, place.row, PixelThreads(), place.scratch);
}

__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    RestoreKernel(const __grid_constant__ MatchContext<MaskedTextureSampler> context, const CoarserEstimate coarser,
                  int scratch_words, int color) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  const int col = ColOfGroup(place, color);
  if (col >= context.width || place.row >= context.height) return;
  RestorePixel(context, coarser, col, place.row, PixelThreads(), place.scratch);
}

template <Pass kPass, class Sampler>
void LaunchSteps(const MatchContext<Sampler>& context, int iterations, cudaStream_t stream) {
  const GroupGrid grid(context);
  InitializeKernel<kPass><<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, grid.scratch_words);
  CudaCheck(cudaGetLastError(), "launch initialisation");
  LaunchIterations<kPass, Method::kOurs>(context, grid, iterations, stream);
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 blocks(DivideUp(DivideUp(context.width, 2), kBlockWidth), DivideUp(context.height, kBlockHeight));
  for (int color = 0; color < 2; ++color) {
    FilterKernel<<<blocks, block, 0, stream>>>(context, color);
    CudaCheck(cudaGetLastError(), "launch median filter");
  }
}

/// Calls function(context) with a context for kernels that know masks where there are any.
template <class Function>
void VisitMasks(const CudaMatchContext& context, const Function& function) {
  const bool has_masks = context.mask_distance.data != nullptr || context.source_mask_distances != nullptr;
  if (has_masks) return function(WithMasks(context));
  function(context);
}

}  // namespace

template <Pass kPass, Method kMethod>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream) {
  if constexpr (kMethod == Method::kOurs) {
    VisitMasks(context, [&](const auto& chosen) { LaunchSteps<kPass>(chosen, iterations, stream); });
  } else {
    const MatchContext<MaskedTextureSampler> masked = WithMasks(context);
    const GroupGrid grid(masked);
    for (int color = 0; color < 2; ++color) {
      InitializeOfPapersKernel<kPass, kMethod>
          <<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(masked, grid.scratch_words, color);
      CudaCheck(cudaGetLastError(), "launch initialisation");
    }
    LaunchIterations<kPass, kMethod>(masked, grid, iterations, stream);
  }
}

template void LaunchPass<Pass::kPhotometric, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPhotometric, Method::kAcmh>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior, Method::kAcmp>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kAcmh>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kAcmp>(const CudaMatchContext&, int, cudaStream_t);

void LaunchRestoreDetails(const CudaMatchContext& unmasked, const CoarserEstimate& coarser, cudaStream_t stream) {
  const MatchContext<MaskedTextureSampler> context = WithMasks(unmasked);
  const GroupGrid grid(context);
  for (int color = 0; color < 2; ++color) {
    RestoreKernel<<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, coarser, grid.scratch_words, color);
    CudaCheck(cudaGetLastError(), "launch detail restorer");
  }
}

void LaunchMeasureEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence,
                           cudaStream_t stream) {
  const dim3 grid(DivideUp(evidence.width * CellThreads::kSize, kEvidenceThreads), evidence.height);
  VisitMasks(context, [&](const auto& chosen) {
    MeasureEvidenceKernel<<<grid, kEvidenceThreads, 0, stream>>>(chosen, cell_size, evidence);
  });
  CudaCheck(cudaGetLastError(), "launch evidence");
}

cudaError_t ProbeKernels() {
  cudaFuncAttributes attributes;
  return cudaFuncGetAttributes(&attributes, UpdateKernel<Pass::kPhotometric, Method::kOurs, TextureSampler>);
}

}  // namespace acmp
