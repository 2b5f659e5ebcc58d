#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/engine/fusion_engine.h"
#include "acmp_mapping/fusion/fusion_setup.h"
#include "device_queue.h"
#include "fusion_kernels.h"
#include "staged_copy.h"

namespace acmp {

// An engine's views as the fusion's kernels read them. Views without a frame, reference views without an estimate and
// estimates of another size or device are an InvalidInputError.

PosedCamera PosedCameraOf(const EngineView& view);

/// Without colours.
DeviceFusionView GeometryMapsOf(const EngineView& view, DeviceQueue* queue);
/// With colours, where the frame has some.
DeviceFusionView FusionMapsOf(const EngineView& view, DeviceQueue* queue);

/// The reference's estimate against the sources' in the reference's camera frame.
/// @param maps_of GeometryMapsOf or FusionMapsOf
FusionSetup<DeviceFusionView> SetUpViews(const EngineView& reference, const std::vector<EngineView>& sources,
                                         const FusionLimits& limits,
                                         DeviceFusionView (*maps_of)(const EngineView&, DeviceQueue*),
                                         DeviceQueue* queue);

/// What is made of finished estimates on the GPU, with the memory of one reference view at a time.
class CudaFusion : public virtual FusionEngine {
 public:
  /// @param queue outlives this
  explicit CudaFusion(DeviceQueue* queue) : queue_(*queue) {}

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override;
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override;
  std::unique_ptr<FusionStamps> MakeFusionStamps() override;
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override;
  Image<unsigned char> FusedPixels(const Frame& frame, FusionStamps* stamps) override;
  void SetFusedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps) override;

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
  DeviceArray<SurfacePoint> of_pixels_, points_;
  DeviceArray<unsigned char> accepted_, scratch_;
  DeviceArray<unsigned> count_;
  DeviceArray<float> confidence_, log_odds_;
};

}  // namespace acmp
