#include <cstring>
#include <cub/device/device_select.cuh>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"
#include "cuda_resources.h"
#include "kernels.h"

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

/// function(col, row, place in the range) for a pixel of the range.
template <class Function>
__global__ void __launch_bounds__(kPointThreads)
    RangeKernel(const __grid_constant__ Function function, const PixelRange range, int width) {
  const size_t in_range = static_cast<size_t>(blockIdx.x) * kPointThreads + threadIdx.x;
  const unsigned index = static_cast<unsigned>(range.first + in_range);
  if (in_range < range.count) function(static_cast<int>(index % width), static_cast<int>(index / width), in_range);
}

template <class Function>
void LaunchForRange(const char* what, const PixelRange& range, int width, cudaStream_t stream,
                    const Function& function) {
  const int blocks = static_cast<int>((range.count + kPointThreads - 1) / kPointThreads);
  RangeKernel<<<blocks, kPointThreads, 0, stream>>>(function, range, width);
  CudaCheck(cudaGetLastError(), what);
}

__device__ void WritePoint(bool accepted, const SurfacePoint& point, size_t in_range, const PointOutput& output) {
  if (output.of_pixels == nullptr) return;
  PackedPoint packed;
  memcpy(&packed, &point, sizeof(packed));
  reinterpret_cast<PackedPoint*>(output.of_pixels)[in_range] = packed;
  output.accepted[in_range] = accepted ? 1 : 0;
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
  const ImageView<float> odds = {log_odds, width, height, width};
  LaunchForRange("launch odds of depths", {0, static_cast<size_t>(width) * height}, width, stream,
                 [=] __device__(int col, int row, size_t) { odds(col, row) = LogOdds(context, col, row); });
  context.log_odds = odds;
  return context;
}

void LaunchFilterByConsistency(const FusionContext& context, const PixelRange& range,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream) {
  LaunchForRange("launch consistency check", range, confidence.width, stream,
                 [=] __device__(int col, int row, size_t in_range) {
                   SurfacePoint point = {};
                   const bool accepted = CheckPixel(context, col, row, &confidence(col, row), &point);
                   WritePoint(accepted, point, in_range, output);
                 });
  size_t bytes = output.scratch_bytes;
  if (output.of_pixels != nullptr) GatherPoints(output, range.count, &bytes, stream);
}

void LaunchFuseView(const FusionContext& context, const PixelRange& range, const PointOutput& output,
                    cudaStream_t stream) {
  LaunchForRange("launch fusion", range, context.stamps.width, stream,
                 [=] __device__(int col, int row, size_t in_range) {
                   SurfacePoint point = {};
                   const bool accepted = FusePixel(context, col, row, &point);
                   WritePoint(accepted, point, in_range, output);
                 });
  size_t bytes = output.scratch_bytes;
  GatherPoints(output, range.count, &bytes, stream);
}

}  // namespace acmp
