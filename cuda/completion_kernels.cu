#include "completion_kernels.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/completion/kernel/complete_pixel.h"
#include "acmp_mapping/completion/kernel/fit_anchor.h"
#include "acmp_mapping/completion/kernel/nearest_anchor.h"
#include "acmp_mapping/completion/kernel/refute_pixel.h"
#include "acmp_mapping/completion/kernel/sightings.h"
#include "cuda_check.h"
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

__global__ void LookKernel(const __grid_constant__ DeviceFusionContext views, ImageView<Sightings> sightings) {
  const int col = Col(), row = Row();
  if (sightings.Contains(col, row)) sightings(col, row) = LookAtPixel(views, col, row);
}

__global__ void LookAgainKernel(const __grid_constant__ DeviceFusionContext views, ImageView<Sightings> sightings) {
  const int col = Col(), row = Row();
  if (!sightings.Contains(col, row) || !IsCompleted(views.reference.Cost(col, row))) return;
  sightings(col, row) = LookAtPixel(views, col, row);
}

/// A warp that shares a cell.
struct WarpThreads : WarpGroup<32> {
  __device__ void AddUp(PlaneFit* fit) const {
    float* sums[] = {&fit->s1, &fit->sx, &fit->sy, &fit->sxx, &fit->sxy, &fit->syy, &fit->q, &fit->qx, &fit->qy};
    for (float* sum : sums) *sum = Sum(*sum);
  }
  __device__ void Best(AnchorChoice* choice) const {
    for (int bit = 1; bit < kSize; bit *= 2) {
      const AnchorChoice other = {Across(bit, choice->is_sure ? 1 : 0) != 0, Across(bit, choice->views),
                                  Across(bit, choice->cost), Across(bit, choice->index)};
      if (other.IsBetterThan(*choice)) *choice = other;
    }
  }
};

/// One warp per cell.
__global__ void FindAnchorKernel(const __grid_constant__ CompletionContext context) {
  const int col = static_cast<int>(blockIdx.x), row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (context.anchors.Contains(col, row)) FindAnchor(context, col, row, WarpThreads());
}

/// One warp per cell.
__global__ void FitAnchorKernel(const __grid_constant__ CompletionContext context) {
  const int col = static_cast<int>(blockIdx.x), row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (context.anchors.Contains(col, row)) FitAnchor(context, col, row, WarpThreads());
}

/// One thread per cell and direction. Neighbours look in the same one: they read cells side by side.
__global__ void FindNearestAnchorKernel(const __grid_constant__ CompletionContext context) {
  constexpr int kCellsAtOnce = 8;
  const int col = Col(), row = Row(), direction = static_cast<int>(blockIdx.z);
  if (context.nearest.Contains(col, row)) FindNearestAnchor<kCellsAtOnce>(context, col, row, direction);
}

__global__ void CompletePixelKernel(const __grid_constant__ CompletionContext context) {
  const int col = Col(), row = Row();
  if (context.planes.Contains(col, row)) CompletePixel(context, col, row);
}

__global__ void FindEvidentAnchorKernel(const __grid_constant__ CompletionContext context,
                                        ImageView<const float> evidence) {
  const int col = Col(), row = Row();
  if (evidence.Contains(col, row)) FindEvidentAnchor(context, evidence, col, row);
}

__global__ void RefutePixelKernel(const __grid_constant__ CompletionContext context) {
  const int col = Col(), row = Row();
  if (context.planes.Contains(col, row)) RefutePixel(context, col, row);
}

/// Threads that share a pixel. With all samples of a pixel one thread has 166 registers.
using MedianThreads = WarpGroup<4>;

__global__ void __launch_bounds__(kBlockWidth* kBlockHeight)
    FilterPixelKernel(const __grid_constant__ MedianContext context) {
  const int col = Col() / MedianThreads::kSize, row = Row();
  if (context.planes.Contains(col, row)) FilterPixel(context, col, row, MedianThreads());
}

void LaunchFindNearestAnchor(const CompletionContext& context, cudaStream_t stream) {
  dim3 grid = GridFor(context.nearest);
  grid.z = kNumDirections;
  FindNearestAnchorKernel<<<grid, dim3(kBlockWidth, kBlockHeight), 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch search for the nearest anchors");
}

}  // namespace

void LaunchLook(const DeviceFusionContext& sources, const ImageView<Sightings>& sightings, cudaStream_t stream) {
  CheckRange("number of source views on a GPU", sources.num_sources, 0, kMaxCudaFusionSources);
  LookKernel<<<GridFor(sightings), dim3(kBlockWidth, kBlockHeight), 0, stream>>>(sources, sightings);
  CudaCheck(cudaGetLastError(), "launch look at the sources");
}

void LaunchCompletion(const CompletionContext& context, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 warps(context.anchors.width, (context.anchors.height + kBlockHeight - 1) / kBlockHeight);
  const dim3 block_of_warps(WarpThreads::kSize, kBlockHeight);
  FindAnchorKernel<<<warps, block_of_warps, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch search for anchors");
  FitAnchorKernel<<<warps, block_of_warps, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch plane fits");
  LaunchFindNearestAnchor(context, stream);
  CompletePixelKernel<<<GridFor(context.planes), block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch completion");
}

void LaunchWeightedMedian(const DeviceFusionContext& views, const ImageView<Sightings>& sightings,
                          const MedianContext& context, cudaStream_t stream) {
  CheckRange("number of source views on a GPU", views.num_sources, 0, kMaxCudaFusionSources);
  const dim3 block(kBlockWidth, kBlockHeight);
  LookAgainKernel<<<GridFor(sightings), block, 0, stream>>>(views, sightings);
  CudaCheck(cudaGetLastError(), "launch second look at the sources");
  dim3 grid = GridFor(context.planes);
  grid.x = (context.planes.width * MedianThreads::kSize + kBlockWidth - 1) / kBlockWidth;
  FilterPixelKernel<<<grid, block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch weighted median");
}

void LaunchRefutation(const CompletionContext& context, const ImageView<const float>& evidence, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  FindEvidentAnchorKernel<<<GridFor(evidence), block, 0, stream>>>(context, evidence);
  CudaCheck(cudaGetLastError(), "launch search for evident pixels");
  LaunchFindNearestAnchor(context, stream);
  RefutePixelKernel<<<GridFor(context.planes), block, 0, stream>>>(context);
  CudaCheck(cudaGetLastError(), "launch refutation");
}

}  // namespace acmp
