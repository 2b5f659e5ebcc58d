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

  /// The setup on the device, with the odds of its depths queued.
  DeviceFusionContext Upload(const Setup& setup);
  /// The map of confidences, of the reference's size.
  ImageView<float> ReserveConfidence(const Setup& setup);
  /// launch(range, output) for all pixels, a part after the other, so that the device needs room for the points of one
  /// part. The host takes those of the part before meanwhile.
  template <class Launch>
  PointCloud Collect(size_t pixels, const Launch& launch);

  DeviceQueue& queue_;
  PinnedBuffer points_on_host_, counts_on_host_;
  CudaEvent filled_[2];
  StagedDownload download_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<SurfacePoint> points_;
  DeviceArray<unsigned> count_;
  DeviceArray<unsigned char> scratch_;
  DeviceArray<float> confidence_, log_odds_;
};

}  // namespace acmp
