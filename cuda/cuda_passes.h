#pragma once

#include "cuda_prior.h"
#include "pass_context.h"

namespace acmp {

/// The passes of Algorithm 1 and the steps between two levels on the GPU; see MatchingEngine.
class CudaPasses {
 public:
  /// All outlive this.
  CudaPasses(DeviceQueue* queue, HalvedDepths* halved, CudaPrior* prior)
      : queue_(*queue), halved_(*halved), prior_(*prior), context_(queue, halved) {}

  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level);
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   const EngineEstimatePtr& start, const PriorMesh& prior);
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 const EngineEstimatePtr& start, int pass);
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   const EngineEstimatePtr& start, const EngineEstimatePtr& coarser);
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level);

 private:
  template <Pass kPass>
  EngineEstimatePtr Run(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                        const EngineEstimatePtr& start, const PriorMesh* prior, int geometric_pass, int iterations);

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  CudaPrior& prior_;
  PassContext context_;
};

}  // namespace acmp
