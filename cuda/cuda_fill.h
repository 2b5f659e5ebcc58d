#pragma once

#include "acmp_mapping/fill/fill.h"
#include "cuda_fusion.h"
#include "cuda_passes.h"
#include "fill_kernels.h"

namespace acmp {

/// The filling of what the passes leave unverified and the free-space check on the GPU.
class CudaFill : public virtual MatchingEngine {
 public:
  /// Both outlive this.
  CudaFill(DeviceQueue* queue, HalvedDepths* halved) : queue_(*queue), halved_(*halved), context_(queue, halved) {}

  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override;
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override;

 private:
  using Setup = FusionSetup<DeviceFusionView>;

  /// Queues FillUnverified without the median.
  /// @param sources the reference's maps as they were before, and its source views
  /// @param context from MakeFillContext
  /// @param estimate a copy of the reference's, changed
  void QueueFill(const Setup& sources, FillContext context, CudaEstimate* estimate);
  /// Queues the weighted median of what QueueFill left.
  /// @param sources,context as they were given to it
  /// @param planes of the estimate's size; become those of before, which the stream still reads
  void QueueMedian(const Setup& sources, const FillContext& context, const ImageView<const Rgb>& color,
                   CudaEstimate* estimate, DeviceArray<PlaneHypothesis>* planes);
  /// Where the evidence of so many cells may be written, until the next call.
  ImageView<float> ReserveEvidence(const PinholeCamera& camera, int cell_size);
  /// Queues RemoveUnsupported with that.
  /// @param context from MakeTexturedContext, of maps in device memory
  void QueueFreeSpaceCheck(FillContext context, const ImageView<float>& evidence);

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  PassContext context_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<ViewSupport> support_;
  DeviceArray<SeedCell> cells_;
  DeviceArray<NearestSeeds> nearest_;
  DeviceArray<float> evidence_;
};

}  // namespace acmp
