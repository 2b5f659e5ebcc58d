#pragma once

#include "acmp_mapping/fusion/fusion_setup.h"
#include "cuda_device.h"
#include "fusion_kernels.h"
#include "staged_copy.h"

namespace acmp {

/// The memory of one reference view at a time: checks and fuses views whose maps are on the device.
class FusionRunner {
 public:
  explicit FusionRunner(CudaDevicePtr device) : device_(std::move(device)) {}

  /// FilterByConsistency of the setup's reference view; waits for the result.
  ConsistencyResult Filter(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream);

  /// The confidences of the same.
  ConfidenceMap MeasureConfidence(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream);

  /// FusionEngine::FuseView of one reference view; waits for its points.
  PointCloud Fuse(const FusionSetup<DeviceFusionView>& setup, int width, int height, const CudaStream& stream);

 private:
  void QueueFilter(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream);
  DeviceFusionContext Upload(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream);
  PointOutput ReservePoints(int width, int height);
  PointCloud Download(const CudaStream& stream);

  CudaDevicePtr device_;
  PinnedBuffer count_on_host_;
  StagedDownload download_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<SurfacePoint> points_;
  DeviceArray<unsigned> count_;
  DeviceArray<unsigned char> scratch_, consistent_views_;
  DeviceArray<float> confidence_, log_error_;
};

}  // namespace acmp
