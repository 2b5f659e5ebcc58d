#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// Pixels of the reference, in row-major order, whose points one launch makes.
struct PixelRange {
  size_t first, count;
};

/// Where the points of a range's accepted pixels go, in the order of the pixels; all device memory as cudaMalloc gives
/// it, with room for one element per pixel where nothing else is said.
struct PointOutput {
  SurfacePoint* of_pixels;  ///< what each pixel would be, for the launch alone; null: points are not wanted
  unsigned char* accepted;  ///< 1 where it is a point, else 0; for the launch alone
  SurfacePoint* points;
  unsigned* count;  ///< a single one, set to the number of points
  void* scratch;    ///< PointScratchBytes
  size_t scratch_bytes;
};

/// Bytes of scratch memory to gather the points of so many pixels.
size_t PointScratchBytes(size_t pixels);

/// Queues LogOdds of all pixels of the reference into `log_odds`, device memory.
/// @return the context with them, for the launches below
FusionContext LaunchOdds(FusionContext context, float* log_odds, cudaStream_t stream);

/// Queues FilterByConsistency of a range: fills it in the map of confidences, of the reference's size. All pointers in
/// the context are device memory; its stamps are null.
void LaunchFilterByConsistency(const FusionContext& context, const PixelRange& range,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream);

/// Queues DepthEngine::FuseView of a range. Stamps of all views start at kUnfusedStamp and go on from view to view.
void LaunchFuseView(const FusionContext& context, const PixelRange& range, const PointOutput& output,
                    cudaStream_t stream);

}  // namespace acmp
