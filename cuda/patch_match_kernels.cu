#include "patch_match_kernels.h"

#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "cuda_check.h"

namespace acmp {
namespace {

constexpr int kBlockWidth = 32;
constexpr int kBlockHeight = 4;
/// Caps registers at 128: on an H200 more threads in flight bring more than the spills cost (40 against 53 ms per
/// image).
constexpr int kUpdateBlocksPerMultiprocessor = 4;

template <Pass kPass>
__global__ void __launch_bounds__(kBlockWidth* kBlockHeight) InitializeKernel(const CudaMatchContext context) {
  const int col = blockIdx.x * kBlockWidth + threadIdx.x;
  const int row = blockIdx.y * kBlockHeight + threadIdx.y;
  if (col < context.width && row < context.height) InitializePixel<kPass>(context, col, row);
}

/// Threads of a row cover the pixels of one colour: every second column.
template <Pass kPass>
__global__ void __launch_bounds__(kBlockWidth* kBlockHeight, kUpdateBlocksPerMultiprocessor)
    UpdateKernel(const CudaMatchContext context, int color, int iteration) {
  const int row = blockIdx.y * kBlockHeight + threadIdx.y;
  const int col = 2 * (blockIdx.x * kBlockWidth + threadIdx.x) + ((row + color) & 1);
  if (col < context.width && row < context.height) UpdatePixel<kPass>(context, col, row, iteration);
}

__global__ void __launch_bounds__(kBlockWidth* kBlockHeight) FilterKernel(const CudaMatchContext context, int color) {
  const int row = blockIdx.y * kBlockHeight + threadIdx.y;
  const int col = 2 * (blockIdx.x * kBlockWidth + threadIdx.x) + ((row + color) & 1);
  if (col < context.width && row < context.height) FilterPixel(context, col, row);
}

int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

}  // namespace

template <Pass kPass>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const unsigned rows = DivideUp(context.height, kBlockHeight);
  const dim3 full_grid(DivideUp(context.width, kBlockWidth), rows);
  const dim3 half_grid(DivideUp(DivideUp(context.width, 2), kBlockWidth), rows);
  InitializeKernel<kPass><<<full_grid, block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch initialisation");
  for (int iteration = 0; iteration < iterations; ++iteration) {
    for (int color = 0; color < 2; ++color) {
      UpdateKernel<kPass><<<half_grid, block, 0, stream>>>(context, color, iteration);
      CudaCheck(cudaGetLastError(), "launch update");
    }
  }
  if (!context.options.median_filter) return;
  for (int color = 0; color < 2; ++color) {
    FilterKernel<<<half_grid, block, 0, stream>>>(context, color);
    CudaCheck(cudaGetLastError(), "launch median filter");
  }
}

template void LaunchPass<Pass::kPhotometric>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric>(const CudaMatchContext&, int, cudaStream_t);

cudaError_t ProbeKernels() {
  cudaFuncAttributes attributes;
  return cudaFuncGetAttributes(&attributes, UpdateKernel<Pass::kPhotometric>);
}

}  // namespace acmp
