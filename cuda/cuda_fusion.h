#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/engine/fusion_engine.h"
#include "device_queue.h"
#include "fusion_runner.h"

namespace acmp {

/// What is made of finished estimates on the GPU; see FusionEngine.
class CudaFusion {
 public:
  /// @param queue outlives this
  explicit CudaFusion(DeviceQueue* queue) : queue_(*queue), runner_(queue->device()) {}

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options);
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options);
  static std::unique_ptr<FusionStamps> MakeStamps();
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps);

 private:
  DeviceQueue& queue_;
  FusionRunner runner_;
};

}  // namespace acmp
