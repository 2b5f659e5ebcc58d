#include "fill_kernels.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/free_space.h"
#include "cuda_resources.h"
#include "warp_group.h"

namespace acmp {
namespace {

constexpr int kBlockWidth = 32;
constexpr int kBlockHeight = 4;

template <class T>
dim3 GridFor(const ImageView<T>& image) {
  return dim3((image.width + kBlockWidth - 1) / kBlockWidth, (image.height + kBlockHeight - 1) / kBlockHeight);
}

__device__ int Col() { return static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x); }
__device__ int Row() { return static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y); }

__global__ void LookKernel(const __grid_constant__ FusionContext views, ImageView<ViewSupport> support) {
  const int col = Col(), row = Row();
  if (support.Contains(col, row)) support(col, row) = CountSupportingViews(views, col, row);
}

__global__ void LookAgainKernel(const __grid_constant__ FusionContext views, ImageView<ViewSupport> support) {
  const int col = Col(), row = Row();
  if (!support.Contains(col, row) || !IsFilled(views.reference.cost(col, row))) return;
  support(col, row) = CountSupportingViews(views, col, row);
}

/// A warp that shares a cell.
struct WarpThreads : WarpGroup<32> {
  __device__ void AddUp(PlaneFit* fit) const {
    float* sums[] = {&fit->s1, &fit->sx, &fit->sy, &fit->sxx, &fit->sxy, &fit->syy, &fit->q, &fit->qx, &fit->qy};
    for (float* sum : sums) *sum = Sum(*sum);
  }
  __device__ void Best(SeedChoice* choice) const {
    for (int bit = 1; bit < kSize; bit *= 2) {
      const SeedChoice other = {Across(bit, choice->is_strong ? 1 : 0) != 0, Across(bit, choice->views),
                                Across(bit, choice->cost), Across(bit, choice->index)};
      if (other.IsBetterThan(*choice)) *choice = other;
    }
  }
};

/// One warp per cell.
__global__ void FindSeedKernel(const __grid_constant__ FillContext context) {
  const int col = static_cast<int>(blockIdx.x), row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (context.seeds.Contains(col, row)) FindSeed(context, col, row, WarpThreads());
}

/// One warp per cell.
__global__ void FitSeedKernel(const __grid_constant__ FillContext context) {
  const int col = static_cast<int>(blockIdx.x), row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (context.seeds.Contains(col, row)) FitSeed(context, col, row, WarpThreads());
}

/// One thread per cell and direction. Neighbours look in the same one: they read cells side by side.
__global__ void FindNearestSeedKernel(const __grid_constant__ FillContext context) {
  constexpr int kCellsAtOnce = 8;
  const int col = Col(), row = Row(), direction = static_cast<int>(blockIdx.z);
  if (context.nearest.Contains(col, row)) FindNearestSeed<kCellsAtOnce>(context, col, row, direction);
}

__global__ void FillPixelKernel(const __grid_constant__ FillContext context) {
  const int col = Col(), row = Row();
  if (context.planes.Contains(col, row)) FillPixel(context, col, row);
}

__global__ void FindTexturedSeedKernel(const __grid_constant__ FillContext context, ImageView<const float> evidence) {
  const int col = Col(), row = Row();
  if (evidence.Contains(col, row)) FindTexturedSeed(context, evidence, col, row);
}

__global__ void RemoveUnsupportedKernel(const __grid_constant__ FillContext context) {
  const int col = Col(), row = Row();
  if (context.planes.Contains(col, row)) RemoveUnsupportedPixel(context, col, row);
}

/// Threads that share a pixel. With all samples of a pixel one thread has 166 registers.
using MedianThreads = WarpGroup<4>;

__global__ void __launch_bounds__(kBlockWidth* kBlockHeight)
    WeightedMedianKernel(const __grid_constant__ MedianContext context) {
  const int col = Col() / MedianThreads::kSize, row = Row();
  if (context.planes.Contains(col, row)) WeightedMedianPixel(context, col, row, MedianThreads());
}

void LaunchFindNearestSeed(const FillContext& context, cudaStream_t stream) {
  dim3 grid = GridFor(context.nearest);
  grid.z = kNumDirections;
  FindNearestSeedKernel<<<grid, dim3(kBlockWidth, kBlockHeight), 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch search for the nearest seeds");
}

}  // namespace

void LaunchLook(const FusionContext& sources, const ImageView<ViewSupport>& support, cudaStream_t stream) {
  LookKernel<<<GridFor(support), dim3(kBlockWidth, kBlockHeight), 0, stream>>>(sources, support);
  CudaCheck(cudaGetLastError(), "launch look at the sources");
}

void LaunchFill(const FillContext& context, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 warps(context.seeds.width, (context.seeds.height + kBlockHeight - 1) / kBlockHeight);
  const dim3 block_of_warps(WarpThreads::kSize, kBlockHeight);
  FindSeedKernel<<<warps, block_of_warps, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch search for seeds");
  FitSeedKernel<<<warps, block_of_warps, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch plane fits");
  LaunchFindNearestSeed(context, stream);
  FillPixelKernel<<<GridFor(context.planes), block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch completion");
}

void LaunchWeightedMedian(const FusionContext& views, const ImageView<ViewSupport>& support,
                          const MedianContext& context, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  LookAgainKernel<<<GridFor(support), block, 0, stream>>>(views, support);
  CudaCheck(cudaGetLastError(), "launch second look at the sources");
  dim3 grid = GridFor(context.planes);
  grid.x = (context.planes.width * MedianThreads::kSize + kBlockWidth - 1) / kBlockWidth;
  WeightedMedianKernel<<<grid, block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch weighted median");
}

void LaunchFreeSpaceCheck(const FillContext& context, const ImageView<const float>& evidence, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  FindTexturedSeedKernel<<<GridFor(evidence), block, 0, stream>>>(context, evidence);
  CudaCheck(cudaGetLastError(), "launch search for textured pixels");
  LaunchFindNearestSeed(context, stream);
  RemoveUnsupportedKernel<<<GridFor(context.planes), block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch free-space check");
}

}  // namespace acmp
