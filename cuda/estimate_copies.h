#pragma once

#include "acmp_mapping/engine/estimate_transfer.h"
#include "cuda_estimate.h"
#include "staged_copy.h"

namespace acmp {

/// The way of estimates to the host, back, and from one GPU to another.
class EstimateCopies : public virtual EstimateTransfer {
 public:
  /// @param queue outlives this
  explicit EstimateCopies(DeviceQueue* queue) : queue_(*queue) {}

  EstimateMaps Download(const EngineEstimatePtr& estimate) override;
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override;
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override;
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override;
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override;

 private:
  DeviceQueue& queue_;
  StagedDownload download_;
};

}  // namespace acmp
