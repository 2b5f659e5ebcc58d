#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "group_kernels.h"

namespace acmp {
namespace {

constexpr int kFilterCols = 32;
constexpr int kFilterRows = 4;

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
__global__ void __launch_bounds__(kFilterCols* kFilterRows)
    FilterKernel(const __grid_constant__ MatchContext<Sampler> context, int color) {
  const int row = static_cast<int>(blockIdx.y * kFilterRows + threadIdx.y);
  const int col = 2 * static_cast<int>(blockIdx.x * kFilterCols + threadIdx.x) + ((row + color) & 1);
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

template <class Sampler>
void LaunchFilter(const MatchContext<Sampler>& context, cudaStream_t stream) {
  const dim3 block(kFilterCols, kFilterRows);
  const dim3 grid(DivideUp(DivideUp(context.width, 2), kFilterCols), DivideUp(context.height, kFilterRows));
  for (int color = 0; color < 2; ++color) {
    FilterKernel<<<grid, block, 0, stream>>>(context, color);
    CudaCheck(cudaGetLastError(), "launch median filter");
  }
}

template <Pass kPass, class Sampler>
void LaunchSteps(const MatchContext<Sampler>& context, int iterations, cudaStream_t stream) {
  const GroupGrid grid(context);
  InitializeKernel<kPass><<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, grid.scratch_words);
  CudaCheck(cudaGetLastError(), "launch initialisation");
  LaunchIterations<kPass, Method::kOurs>(context, grid, iterations, stream);
  LaunchFilter(context, stream);
}

/// Calls function(context) with a context for kernels that know masks where there are any.
template <class Function>
void VisitMasks(const CudaMatchContext& context, const Function& function) {
  if (HasMasks(context)) return function(WithMasks(context));
  function(context);
}

}  // namespace

template <Pass kPass, Method kMethod>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream) {
  static_assert(kMethod == Method::kOurs, "those of the papers are in paper_kernels.cu");
  VisitMasks(context, [&](const auto& chosen) { LaunchSteps<kPass>(chosen, iterations, stream); });
}

void LaunchMeasureEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence,
                           cudaStream_t stream) {
  const dim3 grid(DivideUp(evidence.width * CellThreads::kSize, kEvidenceThreads), evidence.height);
  VisitMasks(context, [&](const auto& chosen) {
    MeasureEvidenceKernel<<<grid, kEvidenceThreads, 0, stream>>>(chosen, cell_size, evidence);
  });
  CudaCheck(cudaGetLastError(), "launch evidence");
}

template void LaunchPass<Pass::kPhotometric, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kOurs>(const CudaMatchContext&, int, cudaStream_t);

cudaError_t ProbeKernels() {
  cudaFuncAttributes attributes;
  return cudaFuncGetAttributes(&attributes, UpdateKernel<Pass::kPhotometric, Method::kOurs, TextureSampler>);
}

}  // namespace acmp
