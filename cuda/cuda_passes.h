#pragma once

#include "acmp_mapping/engine/matching_engine.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
#include "cuda_prior.h"
#include "patch_match_kernels.h"

namespace acmp {

/// Makes the contexts that passes run on, of an engine's handles. Holds the memory of one at a time.
class PassContext {
 public:
  /// @param queue,halved outlive this
  PassContext(DeviceQueue* queue, HalvedDepths* halved) : queue_(*queue), halved_(*halved) {}

  /// The context of a pass over an estimate, until the next call: geometric passes read the sources' depths, the views
  /// that pixels select take the place of the estimate's depths, and there is no prior. Queues the upload of what it
  /// points to: whoever then starts the clock does not count the host's work. The caller holds images_mutex() shared
  /// from here until the stream has been waited for.
  /// @param match MakePatchMatchProblem of the problem at that level
  CudaMatchContext Prepare(const EngineProblem& problem, const PatchMatchProblem& match, int level,
                           const PatchMatchOptions& options, Pass kind, int geometric_pass, CudaEstimate* estimate);

 private:
  /// Throws InvalidInputError unless the sources' estimates are of the level.
  void AddDepths(const EngineProblem& problem, const PatchMatchProblem& match, Method method, SourceView* views,
                 ImageView<const float>* full_depths);
  /// Where the reference or a source has a mask.
  void AddMasks(const EngineProblem& problem, int level, CudaMatchContext* context);

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  DeviceArray<SourceView> views_;
  DeviceArray<ImageView<const float>> full_depths_;
  DeviceArray<ImageView<const unsigned char>> mask_distances_;
  PinnedBuffer host_views_, host_full_depths_, host_mask_distances_;
};

/// The passes of Algorithm 1 and the steps between two levels on the GPU.
class CudaPasses : public virtual MatchingEngine {
 public:
  /// All outlive this.
  CudaPasses(DeviceQueue* queue, HalvedDepths* halved, CudaPrior* prior)
      : queue_(*queue), halved_(*halved), prior_(*prior), context_(queue, halved) {}

  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override;
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override;
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override;
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override;
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override;

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
