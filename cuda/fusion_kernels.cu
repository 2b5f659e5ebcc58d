#include "fusion_kernels.h"

#include <cstring>
#include <cub/block/block_scan.cuh>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"
#include "cuda_check.h"

namespace acmp {
namespace {

// Points are put in order in three steps: a block of threads packs those of its pixels, which follow each other in
// row-major order, at the start of its own part of the scratch memory; one block adds up how many there are before each
// block; all blocks copy. Only accepted points are moved, 96 bytes each.

constexpr int kPointThreads = 256;  ///< pixels per block
constexpr int kScanThreads = 1024;

/// A point as it is stored, in two instructions. With the padding byte, which thereby has a value.
struct alignas(16) PackedPoint {
  uint4 words[2];
};
static_assert(sizeof(PackedPoint) == sizeof(SurfacePoint), "points are copied as words");

__device__ PackedPoint Pack(const SurfacePoint& point) {
  PackedPoint packed;
  memcpy(&packed, &point, sizeof(packed));
  return packed;
}

/// The scratch memory of a launch.
struct PointStage {
  PackedPoint* points;  ///< kPointThreads per block
  unsigned* first;      ///< per block: number of its points, then of all points before it; one more for the end
};

int NumBlocks(int width, int height) {
  return static_cast<int>((static_cast<size_t>(width) * height + kPointThreads - 1) / kPointThreads);
}

PointStage StageIn(void* scratch, int num_blocks) {
  PackedPoint* points = static_cast<PackedPoint*>(scratch);
  return {points, reinterpret_cast<unsigned*>(points + static_cast<size_t>(num_blocks) * kPointThreads)};
}

/// The calling thread's pixel in row-major order; rows beyond the last are outside.
struct PixelPlace {
  int col, row;
};

__device__ PixelPlace PlaceOfThread(int width) {
  const unsigned index = blockIdx.x * kPointThreads + threadIdx.x;
  return {static_cast<int>(index % width), static_cast<int>(index / width)};
}

/// Called by all threads of a block: packs the points of those that have one.
__device__ void StagePoint(bool accepted, const SurfacePoint& point, const PointStage& stage) {
  using Scan = cub::BlockScan<unsigned, kPointThreads>;
  __shared__ typename Scan::TempStorage storage;
  unsigned place, count;
  Scan(storage).ExclusiveSum(accepted ? 1u : 0u, place, count);
  const size_t begin = static_cast<size_t>(blockIdx.x) * kPointThreads;
  if (accepted) stage.points[begin + place] = Pack(point);
  if (threadIdx.x == 0) stage.first[blockIdx.x] = count;
}

__global__ void __launch_bounds__(kPointThreads)
    ErrorKernel(const __grid_constant__ DeviceFusionContext context, const ImageView<float> log_error) {
  const PixelPlace place = PlaceOfThread(log_error.width);
  if (place.row < log_error.height) log_error(place.col, place.row) = LogExpectedError(context, place.col, place.row);
}

__global__ void __launch_bounds__(kPointThreads)
    FilterKernel(const __grid_constant__ DeviceFusionContext context, const ImageView<unsigned char> consistent_views,
                 const ImageView<float> confidence, const PointStage stage) {
  const PixelPlace place = PlaceOfThread(confidence.width);
  SurfacePoint point;
  bool accepted = false;
  if (place.row < confidence.height) {
    const PixelConsistency pixel = CheckPixel<kMaxCudaFusionSources>(context, place.col, place.row, &point);
    consistent_views(place.col, place.row) = static_cast<unsigned char>(pixel.consistent_views);
    confidence(place.col, place.row) = pixel.confidence;
    accepted = pixel.accepted;
  }
  StagePoint(accepted, point, stage);
}

__global__ void __launch_bounds__(kPointThreads)
    FuseKernel(const __grid_constant__ DeviceFusionContext context, const PointStage stage) {
  const PixelPlace place = PlaceOfThread(context.stamps.width);
  SurfacePoint point;
  const bool accepted =
      place.row < context.stamps.height && FusePixel<kMaxCudaFusionSources>(context, place.col, place.row, &point);
  StagePoint(accepted, point, stage);
}

/// One block: turns the blocks' numbers of points into the numbers before them.
__global__ void __launch_bounds__(kScanThreads) ScanKernel(unsigned* first, int num_blocks, unsigned* total) {
  using Scan = cub::BlockScan<unsigned, kScanThreads>;
  __shared__ typename Scan::TempStorage storage;
  unsigned before = 0;
  for (int begin = 0; begin < num_blocks; begin += kScanThreads) {
    const int i = begin + static_cast<int>(threadIdx.x);
    unsigned place, count;
    Scan(storage).ExclusiveSum(i < num_blocks ? first[i] : 0u, place, count);
    if (i < num_blocks) first[i] = before + place;
    before += count;
    __syncthreads();  // the storage is used again
  }
  if (threadIdx.x == 0) *total = first[num_blocks] = before;
}

__global__ void __launch_bounds__(kPointThreads) CopyKernel(const PointStage stage, PackedPoint* points) {
  const unsigned first = stage.first[blockIdx.x], count = stage.first[blockIdx.x + 1] - first;
  const uint4* from = stage.points[static_cast<size_t>(blockIdx.x) * kPointThreads].words;
  uint4* to = points[first].words;
  for (unsigned i = threadIdx.x; i < 2 * count; i += kPointThreads) to[i] = from[i];
}

/// Puts the staged points in order.
void LaunchCollect(const PointStage& stage, int num_blocks, const PointOutput& output, cudaStream_t stream) {
  ScanKernel<<<1, kScanThreads, 0, stream>>>(stage.first, num_blocks, output.count);
  CudaCheck(cudaGetLastError(), "launch point count");
  CopyKernel<<<num_blocks, kPointThreads, 0, stream>>>(stage, reinterpret_cast<PackedPoint*>(output.points));
  CudaCheck(cudaGetLastError(), "launch point copy");
}

/// Queues LogExpectedError of all pixels of the reference.
/// @return the context with them
DeviceFusionContext LaunchErrors(DeviceFusionContext context, float* log_error, cudaStream_t stream) {
  CheckRange("number of source views on a GPU", context.num_sources, 0, kMaxCudaFusionSources);
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  ErrorKernel<<<NumBlocks(width, height), kPointThreads, 0, stream>>>(context, {log_error, width, height, width});
  CudaCheck(cudaGetLastError(), "launch expected errors");
  context.log_error = {log_error, width, height, width};
  return context;
}

}  // namespace

size_t PointScratchBytes(int width, int height) {
  const size_t num_blocks = static_cast<size_t>(NumBlocks(width, height));
  return num_blocks * kPointThreads * sizeof(PackedPoint) + (num_blocks + 1) * sizeof(unsigned);
}

void LaunchFilterByConsistency(const DeviceFusionContext& context, const ImageView<unsigned char>& consistent_views,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream) {
  const int num_blocks = NumBlocks(confidence.width, confidence.height);
  const PointStage stage = StageIn(output.scratch, num_blocks);
  const DeviceFusionContext with_errors = LaunchErrors(context, output.log_error, stream);
  FilterKernel<<<num_blocks, kPointThreads, 0, stream>>>(with_errors, consistent_views, confidence, stage);
  CudaCheck(cudaGetLastError(), "launch consistency check");
  LaunchCollect(stage, num_blocks, output, stream);
}

void LaunchFuseView(const DeviceFusionContext& context, const PointOutput& output, cudaStream_t stream) {
  const int num_blocks = NumBlocks(context.stamps.width, context.stamps.height);
  const PointStage stage = StageIn(output.scratch, num_blocks);
  const DeviceFusionContext with_errors = LaunchErrors(context, output.log_error, stream);
  FuseKernel<<<num_blocks, kPointThreads, 0, stream>>>(with_errors, stage);
  CudaCheck(cudaGetLastError(), "launch fusion");
  LaunchCollect(stage, num_blocks, output, stream);
}

}  // namespace acmp
