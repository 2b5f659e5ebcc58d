#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/engine/fusion_engine.h"
#include "acmp_mapping/fusion/fusion_setup.h"
#include "device_queue.h"
#include "fusion_kernels.h"
#include "staged_copy.h"

namespace acmp {

/// What is made of finished estimates on the GPU, with the memory of one reference view at a time; see FusionEngine.
class CudaFusion {
 public:
  /// @param queue outlives this
  explicit CudaFusion(DeviceQueue* queue) : queue_(*queue) {}

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options);
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options);
  static std::unique_ptr<FusionStamps> MakeStamps();
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps);
  Image<unsigned char> UsedPixels(const Frame& frame, FusionStamps* stamps);
  void SetUsedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps);

 private:
  using Setup = FusionSetup<DeviceFusionView>;

  void QueueFilter(const Setup& setup);
  DeviceFusionContext Upload(const Setup& setup);
  PointOutput ReservePoints(int width, int height);
  /// Waits for the points.
  PointCloud DownloadPoints();

  DeviceQueue& queue_;
  PinnedBuffer count_on_host_;
  StagedDownload download_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<SurfacePoint> points_;
  DeviceArray<unsigned> count_;
  DeviceArray<unsigned char> scratch_, consistent_views_;
  DeviceArray<float> confidence_, log_error_;
};

}  // namespace acmp
