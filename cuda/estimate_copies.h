#pragma once

#include "acmp_mapping/engine/estimate_transfer.h"
#include "cuda_estimate.h"
#include "staged_copy.h"

namespace acmp {

/// The way of estimates to the host, back, and from one GPU to another; see EstimateTransfer.
class EstimateCopies {
 public:
  /// @param queue outlives this
  explicit EstimateCopies(DeviceQueue* queue) : queue_(*queue) {}

  EstimateMaps Download(const EngineEstimatePtr& estimate);
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate);
  EstimateState DownloadState(const EngineEstimatePtr& estimate);
  EngineEstimatePtr UploadState(const EstimateState& state, const PinholeCamera& camera);
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera);
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate);

 private:
  DeviceQueue& queue_;
  StagedDownload download_;
};

}  // namespace acmp
