#include "fusion_kernels.h"

#include <cstring>
#include <cub/block/block_scan.cuh>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"
#include "cuda_check.h"

namespace acmp {
namespace {

// Points keep the order of their pixels: a block of threads counts those of its pixels, which follow each other in
// row-major order, learns from the blocks before it how many there are before (Merrill and Garland 2016, "Single-pass
// parallel prefix scan with decoupled look-back"), and writes its own there.

constexpr int kPointThreads = 256;  ///< pixels per block
constexpr int kWarpThreads = 32;

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

int NumBlocks(size_t pixels) { return static_cast<int>((pixels + kPointThreads - 1) / kPointThreads); }

/// A number of points and what is known of it, in one word that is written at once.
using PointSum = unsigned long long;
constexpr PointSum kUnknown = 0, kOwn = PointSum{1} << 32, kWithAllBefore = PointSum{2} << 32;

__device__ PointSum StateOf(PointSum sum) { return sum >> 32 << 32; }

/// The scratch memory of a launch, zero at its start.
struct PointOrder {
  PointSum* sums;   ///< of each block
  unsigned* begun;  ///< number of blocks that have begun
  int num_blocks;
};

size_t ScratchBytes(int num_blocks) { return static_cast<size_t>(num_blocks) * sizeof(PointSum) + sizeof(unsigned); }

/// Nothing where no points are wanted.
PointOrder QueueOrder(const PointOutput& output, int num_blocks, cudaStream_t stream) {
  if (output.points == nullptr) return {};
  CudaCheck(cudaMemsetAsync(output.scratch, 0, ScratchBytes(num_blocks), stream), "reset numbers of points");
  auto* sums = static_cast<PointSum*>(output.scratch);
  return {sums, reinterpret_cast<unsigned*>(sums + num_blocks), num_blocks};
}

/// Number of the calling block, in the order in which blocks begin: those before it do not wait for it. Called by all
/// its threads.
__device__ unsigned BeginBlock(const PointOrder& order) {
  if (order.sums == nullptr) return blockIdx.x;
  __shared__ unsigned block;
  if (threadIdx.x == 0) block = atomicAdd(order.begun, 1u);
  __syncthreads();
  return block;
}

/// The calling thread's pixel.
struct PixelPlace {
  int col, row;
  bool is_inside;  ///< of the range
};

__device__ PixelPlace PlaceOfThread(unsigned block, const PixelRange& range, int width) {
  const size_t in_range = static_cast<size_t>(block) * kPointThreads + threadIdx.x;
  const unsigned index = static_cast<unsigned>(range.first + in_range);
  return {static_cast<int>(index % width), static_cast<int>(index / width), in_range < range.count};
}

/// Points of all blocks before this one, which has `count`. Called by the first warp.
__device__ unsigned PointsBefore(const PointOrder& order, unsigned block, unsigned count) {
  constexpr unsigned kAll = 0xffffffffu;
  const int lane = static_cast<int>(threadIdx.x);
  volatile PointSum* sums = order.sums;
  if (lane == 0) sums[block] = (block == 0 ? kWithAllBefore : kOwn) | count;
  unsigned before = 0;
  for (int nearest = static_cast<int>(block) - 1; nearest >= 0; nearest -= kWarpThreads) {
    PointSum sum = kWithAllBefore;
    do {
      if (nearest >= lane) sum = sums[nearest - lane];
    } while (__any_sync(kAll, StateOf(sum) == kUnknown));
    const unsigned complete = __ballot_sync(kAll, StateOf(sum) == kWithAllBefore);
    const int last = complete != 0 ? __ffs(static_cast<int>(complete)) - 1 : kWarpThreads - 1;
    unsigned part = lane <= last ? static_cast<unsigned>(sum) : 0;
    for (int step = kWarpThreads / 2; step > 0; step /= 2) part += __shfl_xor_sync(kAll, part, step);
    before += part;
    if (complete != 0) break;
  }
  if (lane == 0 && block != 0) sums[block] = kWithAllBefore | (before + count);
  return before;
}

/// Called by all threads of a block: writes the points of those that have one.
__device__ void WritePoint(bool accepted, const SurfacePoint& point, unsigned block, const PointOrder& order,
                           const PointOutput& output) {
  if (order.sums == nullptr) return;
  using Scan = cub::BlockScan<unsigned, kPointThreads>;
  __shared__ typename Scan::TempStorage storage;
  __shared__ unsigned first;
  unsigned place, count;
  Scan(storage).ExclusiveSum(accepted ? 1u : 0u, place, count);
  if (threadIdx.x < kWarpThreads) {
    const unsigned before = PointsBefore(order, block, count);
    if (threadIdx.x == 0) {
      first = before;
      if (block + 1 == static_cast<unsigned>(order.num_blocks)) *output.count = before + count;
    }
  }
  __syncthreads();
  if (accepted) reinterpret_cast<PackedPoint*>(output.points)[first + place] = Pack(point);
}

__global__ void __launch_bounds__(kPointThreads) OddsKernel(const __grid_constant__ DeviceFusionContext context,
                                                            const PixelRange range, const ImageView<float> log_odds) {
  const PixelPlace place = PlaceOfThread(blockIdx.x, range, log_odds.width);
  if (place.is_inside) log_odds(place.col, place.row) = LogOdds(context, place.col, place.row);
}

__global__ void __launch_bounds__(kPointThreads)
    FilterKernel(const __grid_constant__ DeviceFusionContext context, const PixelRange range,
                 const ImageView<float> confidence, const PointOrder order, const PointOutput output) {
  const unsigned block = BeginBlock(order);
  const PixelPlace place = PlaceOfThread(block, range, confidence.width);
  SurfacePoint point;
  const bool accepted = place.is_inside && CheckPixel<kMaxCudaFusionSources>(context, place.col, place.row,
                                                                             &confidence(place.col, place.row), &point);
  WritePoint(accepted, point, block, order, output);
}

__global__ void __launch_bounds__(kPointThreads)
    FuseKernel(const __grid_constant__ DeviceFusionContext context, const PixelRange range, const PointOrder order,
               const PointOutput output) {
  const unsigned block = BeginBlock(order);
  const PixelPlace place = PlaceOfThread(block, range, context.stamps.width);
  SurfacePoint point;
  const bool accepted = place.is_inside && FusePixel<kMaxCudaFusionSources>(context, place.col, place.row, &point);
  WritePoint(accepted, point, block, order, output);
}

}  // namespace

size_t PointScratchBytes(const PixelRange& range) { return ScratchBytes(NumBlocks(range.count)); }

DeviceFusionContext LaunchOdds(DeviceFusionContext context, float* log_odds, cudaStream_t stream) {
  CheckRange("number of source views on a GPU", context.num_sources, 0, kMaxCudaFusionSources);
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  const PixelRange all = {0, static_cast<size_t>(width) * height};
  OddsKernel<<<NumBlocks(all.count), kPointThreads, 0, stream>>>(context, all, {log_odds, width, height, width});
  CudaCheck(cudaGetLastError(), "launch odds of depths");
  context.log_odds = {log_odds, width, height, width};
  return context;
}

void LaunchFilterByConsistency(const DeviceFusionContext& context, const PixelRange& range,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream) {
  const int num_blocks = NumBlocks(range.count);
  const PointOrder order = QueueOrder(output, num_blocks, stream);
  FilterKernel<<<num_blocks, kPointThreads, 0, stream>>>(context, range, confidence, order, output);
  CudaCheck(cudaGetLastError(), "launch consistency check");
}

void LaunchFuseView(const DeviceFusionContext& context, const PixelRange& range, const PointOutput& output,
                    cudaStream_t stream) {
  const int num_blocks = NumBlocks(range.count);
  const PointOrder order = QueueOrder(output, num_blocks, stream);
  FuseKernel<<<num_blocks, kPointThreads, 0, stream>>>(context, range, order, output);
  CudaCheck(cudaGetLastError(), "launch fusion");
}

}  // namespace acmp
