#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// Maps as the matcher leaves them on the device: `normal` holds its planes.
using DeviceFusionView = FusionMaps<PlaneHypothesis>;
using DeviceFusionSource = FusionSource<DeviceFusionView>;
using DeviceFusionContext = FusionContext<DeviceFusionView>;

/// A thread's versines lie in local memory, 4 bytes per source. As many as the matcher takes.
constexpr int kMaxCudaFusionSources = 32;

/// Where the points of accepted pixels go, in row-major order; all device memory as cudaMalloc gives it.
struct PointOutput {
  SurfacePoint* points;  ///< room for one per pixel
  unsigned* count;       ///< set to the number of points
  void* scratch;         ///< PointScratchBytes
  float* log_error;      ///< room for one per pixel, scratch memory too
};

/// Bytes of scratch memory for one reference view. Its contents matter during a launch only.
size_t PointScratchBytes(int width, int height);

/// Queue FilterByConsistency of one reference view: fills both maps, of the reference's size, and the points. All
/// pointers in the context are device memory; its stamps are null. Throws InvalidInputError for more than
/// kMaxCudaFusionSources sources.
void LaunchFilterByConsistency(const DeviceFusionContext& context, const ImageView<unsigned char>& consistent_views,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream);

/// Queue FusionEngine::FuseView of one reference view. Stamps of all views start at kUnusedStamp and go on from view to
/// view. Throws as LaunchFilterByConsistency.
void LaunchFuseView(const DeviceFusionContext& context, const PointOutput& output, cudaStream_t stream);

}  // namespace acmp
