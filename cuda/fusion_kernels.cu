#include "fusion_kernels.h"

#include <cstring>
#include <cub/device/device_select.cuh>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"
#include "cuda_resources.h"

namespace acmp {
namespace {

// Points keep the order of their pixels: a kernel writes what each pixel would be, and cub gathers those that are
// points.

constexpr int kPointThreads = 256;  ///< pixels per block

/// A point as it is stored, in two instructions. With the padding byte, which thereby has a value.
struct alignas(16) PackedPoint {
  uint4 words[2];
};
static_assert(sizeof(PackedPoint) == sizeof(SurfacePoint), "points are copied as words");

int NumBlocks(size_t pixels) { return static_cast<int>((pixels + kPointThreads - 1) / kPointThreads); }

/// The calling thread's pixel.
struct PixelPlace {
  size_t in_range;
  int col, row;
};

/// False beyond the range.
__device__ bool FindPixel(const PixelRange& range, int width, PixelPlace* place) {
  place->in_range = static_cast<size_t>(blockIdx.x) * kPointThreads + threadIdx.x;
  const unsigned index = static_cast<unsigned>(range.first + place->in_range);
  place->col = static_cast<int>(index % width);
  place->row = static_cast<int>(index / width);
  return place->in_range < range.count;
}

__device__ void WritePoint(bool accepted, const SurfacePoint& point, size_t in_range, const PointOutput& output) {
  if (output.of_pixels == nullptr) return;
  PackedPoint packed;
  memcpy(&packed, &point, sizeof(packed));
  reinterpret_cast<PackedPoint*>(output.of_pixels)[in_range] = packed;
  output.accepted[in_range] = accepted ? 1 : 0;
}

__global__ void __launch_bounds__(kPointThreads)
    OddsKernel(const __grid_constant__ FusionContext context, const PixelRange range, const ImageView<float> log_odds) {
  PixelPlace place;
  if (!FindPixel(range, log_odds.width, &place)) return;
  log_odds(place.col, place.row) = LogOdds(context, place.col, place.row);
}

__global__ void __launch_bounds__(kPointThreads)
    FilterKernel(const __grid_constant__ FusionContext context, const PixelRange range,
                 const ImageView<float> confidence, const PointOutput output) {
  PixelPlace place;
  if (!FindPixel(range, confidence.width, &place)) return;
  SurfacePoint point = {};
  const bool accepted = CheckPixel(context, place.col, place.row, &confidence(place.col, place.row), &point);
  WritePoint(accepted, point, place.in_range, output);
}

__global__ void __launch_bounds__(kPointThreads)
    FuseKernel(const __grid_constant__ FusionContext context, const PixelRange range, const PointOutput output) {
  PixelPlace place;
  if (!FindPixel(range, context.stamps.width, &place)) return;
  SurfacePoint point = {};
  const bool accepted = FusePixel(context, place.col, place.row, &point);
  WritePoint(accepted, point, place.in_range, output);
}

/// Queues the gathering of the accepted pixels' points, or sets `bytes` to what scratch memory it takes where that is
/// null.
void GatherPoints(const PointOutput& output, size_t pixels, size_t* bytes, cudaStream_t stream) {
  CudaCheck(cub::DeviceSelect::Flagged(output.scratch, *bytes, reinterpret_cast<const PackedPoint*>(output.of_pixels),
                                       output.accepted, reinterpret_cast<PackedPoint*>(output.points), output.count,
                                       static_cast<int>(pixels), stream),
            "gather points");
}

}  // namespace

size_t PointScratchBytes(size_t pixels) {
  size_t bytes = 0;
  GatherPoints({}, pixels, &bytes, nullptr);
  return bytes;
}

FusionContext LaunchOdds(FusionContext context, float* log_odds, cudaStream_t stream) {
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  const PixelRange all = {0, static_cast<size_t>(width) * height};
  OddsKernel<<<NumBlocks(all.count), kPointThreads, 0, stream>>>(context, all, {log_odds, width, height, width});
  CudaCheck(cudaGetLastError(), "launch odds of depths");
  context.log_odds = {log_odds, width, height, width};
  return context;
}

void LaunchFilterByConsistency(const FusionContext& context, const PixelRange& range,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream) {
  FilterKernel<<<NumBlocks(range.count), kPointThreads, 0, stream>>>(context, range, confidence, output);
  CudaCheck(cudaGetLastError(), "launch consistency check");
  size_t bytes = output.scratch_bytes;
  if (output.of_pixels != nullptr) GatherPoints(output, range.count, &bytes, stream);
}

void LaunchFuseView(const FusionContext& context, const PixelRange& range, const PointOutput& output,
                    cudaStream_t stream) {
  FuseKernel<<<NumBlocks(range.count), kPointThreads, 0, stream>>>(context, range, output);
  CudaCheck(cudaGetLastError(), "launch fusion");
  size_t bytes = output.scratch_bytes;
  GatherPoints(output, range.count, &bytes, stream);
}

}  // namespace acmp
