#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/free_space.h"
#include "kernels.h"
#include "launch.h"

namespace acmp {
namespace {

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

/// One thread per cell and direction. Neighbours look in the same one: they read cells side by side.
__global__ void FindNearestSeedKernel(const __grid_constant__ FillContext context) {
  constexpr int kCellsAtOnce = 8;
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  const int direction = static_cast<int>(blockIdx.z);
  if (context.nearest.Contains(col, row)) FindNearestSeed<kCellsAtOnce>(context, col, row, direction);
}

/// Threads that share a pixel. With all samples of a pixel one thread has 166 registers.
using MedianThreads = WarpGroup<4>;

__global__ void __launch_bounds__(kBlockWidth* kBlockHeight)
    WeightedMedianKernel(const __grid_constant__ MedianContext context) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x) / MedianThreads::kSize;
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (context.planes.Contains(col, row)) WeightedMedianPixel(context, col, row, MedianThreads());
}

void LaunchFindNearestSeed(const FillContext& context, cudaStream_t stream) {
  const dim3 grid(DivideUp(context.nearest.width, kBlockWidth), DivideUp(context.nearest.height, kBlockHeight),
                  kNumDirections);
  FindNearestSeedKernel<<<grid, dim3(kBlockWidth, kBlockHeight), 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch search for the nearest seeds");
}

}  // namespace

void LaunchLook(const FusionContext& sources, const ImageView<ViewSupport>& support, cudaStream_t stream) {
  LaunchForEach("launch look at the sources", support.width, support.height, stream,
                [=] __device__(int col, int row) { support(col, row) = CountSupportingViews(sources, col, row); });
}

void LaunchFill(const FillContext& context, cudaStream_t stream) {
  const int cols = context.seeds.width, rows = context.seeds.height;
  LaunchWarpForEach("launch search for seeds", cols, rows, stream,
                    [=] __device__(int col, int row) { FindSeed(context, col, row, WarpThreads()); });
  LaunchWarpForEach("launch plane fits", cols, rows, stream,
                    [=] __device__(int col, int row) { FitSeed(context, col, row, WarpThreads()); });
  LaunchFindNearestSeed(context, stream);
  LaunchForEach("launch completion", context.planes.width, context.planes.height, stream,
                [=] __device__(int col, int row) { FillPixel(context, col, row); });
}

void LaunchWeightedMedian(const FusionContext& views, const ImageView<ViewSupport>& support,
                          const MedianContext& context, cudaStream_t stream) {
  LaunchForEach("launch second look at the sources", support.width, support.height, stream,
                [=] __device__(int col, int row) {
                  if (!IsFilled(views.reference.cost(col, row))) return;
                  support(col, row) = CountSupportingViews(views, col, row);
                });
  const dim3 grid(DivideUp(context.planes.width * MedianThreads::kSize, kBlockWidth),
                  DivideUp(context.planes.height, kBlockHeight));
  WeightedMedianKernel<<<grid, dim3(kBlockWidth, kBlockHeight), 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch weighted median");
}

void LaunchFreeSpaceCheck(const FillContext& context, const ImageView<const float>& evidence, cudaStream_t stream) {
  LaunchForEach("launch search for textured pixels", evidence.width, evidence.height, stream,
                [=] __device__(int col, int row) { FindTexturedSeed(context, evidence, col, row); });
  LaunchFindNearestSeed(context, stream);
  LaunchForEach("launch free-space check", context.planes.width, context.planes.height, stream,
                [=] __device__(int col, int row) { RemoveUnsupportedPixel(context, col, row); });
}

}  // namespace acmp
