#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fusion/point_losses.h"

namespace acmp {

/// The CPU's engine: images and estimates are in host memory.
class HostDepthEngine : public DepthEngine {
 public:
  std::unique_ptr<DepthEngine> Share() override;
  EngineImagePtr Load(const FramePtr& frame, int levels) override;
  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, EnginePass pass) override;
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override;
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override;
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override;
  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override;
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override;
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override;
  /// What becomes of the reference's pixels in FilterByConsistency (CountPointLosses).
  PointLosses CountLosses(const EngineView& reference, const std::vector<EngineView>& sources,
                          const FusionOptions& options, int step);
  std::unique_ptr<FusionStamps> MakeFusionStamps() override;
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override;
  EstimateMaps Download(const EngineEstimatePtr& estimate) override;
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override;
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override;
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override;
  double PopDeviceTime() override { return std::exchange(device_ms_, 0.0); }
  size_t DeviceBytes() const override { return 0; }
  size_t FreeDeviceBytes() const override { return 0; }
  std::string device_name() const override;

 private:
  /// Keeps the result of work(), and counts its time.
  template <class Work>
  EngineEstimatePtr Keep(const PinholeCamera& camera, const Work& work);

  double device_ms_ = 0;
};

}  // namespace acmp
