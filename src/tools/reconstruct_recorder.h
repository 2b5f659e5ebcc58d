#pragma once

#include <exception>
#include <memory>
#include <string>

#include "acmp_mapping/patch_match/patch_match.h"
#include "reconstruct_folder.h"
#include "reconstruct_interrupt.h"

namespace acmp {

/// Carries an error through DenseMapper, which would take any std::exception for the failure of one keyframe and go on.
struct RunAborted {
  std::exception_ptr reason;
};

/// Keeps every result of another PatchMatch on disk. The mapper is deterministic: fed with the same frames again it
/// asks for the same passes in the same order, so a run that was interrupted gets the results it already had from here,
/// at the cost of reading a file each.
class RecordingPatchMatch : public PatchMatch {
 public:
  /// @param patch_match not null; all outlive this
  RecordingPatchMatch(PatchMatch* patch_match, const ReconstructFolder* folder, const InterruptWatcher* interrupt);

  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) override;
  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override;
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override;
  PatchMatchTiming last_timing() const override;
  std::string device_name() const override { return patch_match_->device_name(); }

  /// Passes that were really run, not read.
  int passes_run() const { return passes_run_; }

  static constexpr const char* kStage = "passes";

 private:
  template <class Pass>
  PatchMatchResult Recorded(const PatchMatchProblem& problem, const Pass& pass);

  PatchMatch* patch_match_;
  const ReconstructFolder* folder_;
  const InterruptWatcher* interrupt_;
  int next_pass_ = 0;
  int passes_run_ = 0;
  bool last_was_read_ = false;
};

}  // namespace acmp
