#include "patch_match_kernels.h"

#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "cuda_check.h"
#include "warp_group.h"

namespace acmp {
namespace {

/// Threads per pixel, as many as there are candidates: each prepares the comparison of one hypothesis in one view, and
/// four of them make it together. Fewer registers per thread than one thread per pixel leave room for the threads that
/// hide the textures' latency, and their four fetches side by side run at full speed even where neighbouring pixels'
/// hypotheses lie far apart.
constexpr int kTeamSize = 8;
constexpr int kTeamCols = 8;  ///< teams of a block, along and across the rows
constexpr int kTeamRows = 2;
constexpr int kTeamThreads = kTeamSize * kTeamCols * kTeamRows;
/// Threads in flight per multiprocessor against registers per thread (80): on an H200 5 and 8 are slower by 5 to 7 %.
constexpr int kBlocksPerMultiprocessor = 6;

constexpr int kFilterCols = 32;
constexpr int kFilterRows = 4;

struct WarpTeam : WarpGroup<kTeamSize> {
  static constexpr int kWindowThreads = 4;
  __device__ void Sync() const { __syncwarp(Lanes()); }
  __device__ void Increment(int* counter) const { atomicAdd(counter, 1); }
  __device__ float SumOverWindow(float value) const { return WarpGroup<kWindowThreads>::Sum(value); }
  __device__ float SumOverTeam(float value) const { return Sum(value); }
  __device__ bool Any(bool value) const { return __any_sync(Lanes(), value) != 0; }
};

/// Words of shared memory per team. The four teams of a warp read the same part of their patches at once: eight words
/// apart, 16-byte reads of them fall into different banks.
int ScratchWords(int num_sources) {
  const int words = static_cast<int>(sizeof(PixelScratch) / sizeof(float)) + PixelScratch::kWordsPerView * num_sources;
  return (words + 23) / 32 * 32 + 8;
}

/// Pixel and scratch of the calling thread's team.
struct TeamPlace {
  int col, row;  ///< among the teams of the grid
  PixelScratch* scratch;
};

__device__ TeamPlace PlaceOfTeam(int scratch_words) {
  extern __shared__ __align__(16) float scratch[];
  const int team = static_cast<int>(threadIdx.x) / kTeamSize;
  return {static_cast<int>(blockIdx.x) * kTeamCols + team % kTeamCols,
          static_cast<int>(blockIdx.y) * kTeamRows + team / kTeamCols,
          reinterpret_cast<PixelScratch*>(scratch + team * scratch_words)};
}

/// Column of a team's pixel: teams of a row cover the pixels of one colour, every second column.
__device__ int ColOfTeam(const TeamPlace& place, int color) { return 2 * place.col + ((place.row + color) & 1); }

/// A team for two pixels side by side: one of the colour that is updated second, and one that needs no comparison.
template <Pass kPass>
__global__ void __launch_bounds__(kTeamThreads, kBlocksPerMultiprocessor)
    InitializeKernel(const __grid_constant__ CudaMatchContext context, int scratch_words) {
  const TeamPlace place = PlaceOfTeam(scratch_words);
  if (place.row >= context.height) return;
  const WarpTeam team;
  const int unmatched_col = ColOfTeam(place, 0), col = ColOfTeam(place, 1);
  if (team.Rank() == 0 && unmatched_col < context.width) InitializeUnmatched<kPass>(context, unmatched_col, place.row);
  if (col < context.width) InitializePixel<kPass>(context, col, place.row, team, place.scratch);
}

template <Pass kPass>
__global__ void __launch_bounds__(kTeamThreads, kBlocksPerMultiprocessor)
    UpdateKernel(const __grid_constant__ CudaMatchContext context, int scratch_words, int color, int iteration) {
  const TeamPlace place = PlaceOfTeam(scratch_words);
  const int col = ColOfTeam(place, color);
  if (col >= context.width || place.row >= context.height) return;
  UpdatePixel<kPass>(context, col, place.row, iteration, WarpTeam(), place.scratch);
}

__global__ void __launch_bounds__(kFilterCols* kFilterRows)
    FilterKernel(const __grid_constant__ CudaMatchContext context, int color) {
  const int row = static_cast<int>(blockIdx.y * kFilterRows + threadIdx.y);
  const int col = 2 * static_cast<int>(blockIdx.x * kFilterCols + threadIdx.x) + ((row + color) & 1);
  if (col < context.width && row < context.height) FilterPixel(context, col, row);
}

/// Threads that share a cell: one per plane, so that those of a quad read the same image.
using EvidenceLanes = WarpGroup<8>;
constexpr int kEvidenceThreads = 128;

__global__ void __launch_bounds__(kEvidenceThreads)
    MeasureEvidenceKernel(const __grid_constant__ CudaMatchContext context, int cell_size, ImageView<float> evidence) {
  const int col = static_cast<int>(blockIdx.x * kEvidenceThreads + threadIdx.x) / EvidenceLanes::kSize;
  const int row = static_cast<int>(blockIdx.y);
  if (col >= evidence.width) return;
  const EvidenceLanes lanes;
  const float of_cell = EvidenceOfCell(context, col, row, cell_size, lanes);
  if (lanes.Rank() == 0) evidence(col, row) = of_cell;
}

int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

}  // namespace

template <Pass kPass>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream) {
  const int words = ScratchWords(context.num_sources);
  const size_t bytes = static_cast<size_t>(words) * kTeamCols * kTeamRows * sizeof(float);
  const unsigned rows = DivideUp(context.height, kTeamRows);
  const dim3 grid(DivideUp(DivideUp(context.width, 2), kTeamCols), rows);
  InitializeKernel<kPass><<<grid, kTeamThreads, bytes, stream>>>(context, words);
  CudaCheck(cudaGetLastError(), "launch initialisation");
  for (int iteration = 0; iteration < iterations; ++iteration) {
    for (int color = 0; color < 2; ++color) {
      UpdateKernel<kPass><<<grid, kTeamThreads, bytes, stream>>>(context, words, color, iteration);
      CudaCheck(cudaGetLastError(), "launch update");
    }
  }
  if (!context.options.median_filter) return;
  const dim3 filter_block(kFilterCols, kFilterRows);
  const dim3 filter_grid(DivideUp(DivideUp(context.width, 2), kFilterCols), DivideUp(context.height, kFilterRows));
  for (int color = 0; color < 2; ++color) {
    FilterKernel<<<filter_grid, filter_block, 0, stream>>>(context, color);
    CudaCheck(cudaGetLastError(), "launch median filter");
  }
}

void LaunchMeasureEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence,
                           cudaStream_t stream) {
  const dim3 grid(DivideUp(evidence.width * EvidenceLanes::kSize, kEvidenceThreads), evidence.height);
  MeasureEvidenceKernel<<<grid, kEvidenceThreads, 0, stream>>>(context, cell_size, evidence);
  CudaCheck(cudaGetLastError(), "launch evidence");
}

template void LaunchPass<Pass::kPhotometric>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric>(const CudaMatchContext&, int, cudaStream_t);

cudaError_t ProbeKernels() {
  cudaFuncAttributes attributes;
  return cudaFuncGetAttributes(&attributes, UpdateKernel<Pass::kPhotometric>);
}

}  // namespace acmp
