#include "reconstruct_recorder.h"

#include "acmp_mapping/common/error.h"
#include "reconstruct_work_files.h"

namespace acmp {

RecordingPatchMatch::RecordingPatchMatch(PatchMatch* patch_match, const ReconstructFolder* folder,
                                         const InterruptWatcher* interrupt)
    : patch_match_(patch_match), folder_(folder), interrupt_(interrupt) {
  folder_->MakeWorkFolder(kStage);
}

template <class Pass>
PatchMatchResult RecordingPatchMatch::Recorded(const PatchMatchProblem& problem, const Pass& pass) {
  interrupt_->Check();
  const auto path = folder_->WorkFile(kStage, next_pass_++);
  try {
    last_was_read_ = IsWholeWorkFile(path);
    if (last_was_read_) {
      return ReadEstimate(path, problem.reference.camera.width, problem.reference.camera.height);
    }
    ++passes_run_;
    PatchMatchResult result = pass();
    interrupt_->Check();
    WriteEstimate(path, result);
    return result;
  } catch (const InvalidInputError&) {
    throw;  // the keyframe's own fault, and the same in every run
  } catch (const std::exception&) {
    throw RunAborted{std::current_exception()};
  }
}

PatchMatchResult RecordingPatchMatch::RunPhotometric(const PatchMatchProblem& problem,
                                                     const PatchMatchOptions& options) {
  return Recorded(problem, [&] { return patch_match_->RunPhotometric(problem, options); });
}

PatchMatchResult RecordingPatchMatch::RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                                     const PatchMatchResult& start,
                                                     ImageView<const PlaneHypothesis> prior) {
  return Recorded(problem, [&] { return patch_match_->RunPlanarPrior(problem, options, start, prior); });
}

PatchMatchResult RecordingPatchMatch::RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                                   const PatchMatchResult& start, int pass) {
  return Recorded(problem, [&] { return patch_match_->RunGeometric(problem, options, start, pass); });
}

PatchMatchTiming RecordingPatchMatch::last_timing() const {
  return last_was_read_ ? PatchMatchTiming() : patch_match_->last_timing();
}

}  // namespace acmp
