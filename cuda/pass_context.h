#pragma once

#include "acmp_mapping/engine/matching_engine.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
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
  DeviceArray<ImageView<const unsigned char>> clearances_;
  PinnedBuffer host_views_, host_full_depths_, host_clearances_;
};

}  // namespace acmp
