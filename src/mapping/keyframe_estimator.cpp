#include "keyframe_estimator.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "moved_pixels.h"

namespace acmp {
namespace {

using Read = const EngineEstimatePtr& (WindowKeyframe::*)() const;

void ReadEstimates(const SourceViews& sources, Read estimate, EngineProblem* problem) {
  for (size_t i = 0; i < sources.keyframes.size(); ++i) {
    problem->sources[i].estimate = (*sources.keyframes[i].*estimate)();
  }
}

std::vector<MatchedView> MatchedViews(const EngineProblem& problem, const SourceViews& sources) {
  std::vector<MatchedView> views;
  const RigidTransform world_from_reference = problem.reference.cam_from_world().inverse();
  for (size_t i = 0; i < sources.keyframes.size(); ++i) {
    views.push_back({sources.keyframes[i], problem.sources[i].cam_from_world() * world_from_reference});
  }
  return views;
}

}  // namespace

EngineView KeyframeEstimator::MakeView(WindowKeyframe* keyframe) {
  const int levels = estimator_.options().start_level;
  if (!keyframe->image || keyframe->image_levels < levels) {
    keyframe->image = engine_->Load(keyframe->frame, levels);
    keyframe->image_levels = levels;
  }
  return {keyframe->frame, keyframe->image, nullptr, keyframe->pose.refined};
}

EngineProblem KeyframeEstimator::MakeProblem(WindowKeyframe* keyframe, const SourceViews& sources) {
  EngineProblem problem;
  problem.reference = MakeView(keyframe);
  for (const WindowKeyframePtr& source : sources.keyframes) problem.sources.push_back(MakeView(source.get()));
  const float scale = keyframe->pose.placed.scale;
  problem.depth_range = {keyframe->range.min / scale, keyframe->range.max / scale};
  return problem;
}

FinishedEstimate KeyframeEstimator::Initialise(WindowKeyframe* keyframe, const SourceViews& sources) {
  EngineProblem problem = MakeProblem(keyframe, sources);
  problem.reference.estimate = estimator_.Run(estimator_.schedule().front(), problem);
  keyframe->initial = problem.reference.estimate;
  keyframe->initial_score = sources.score;
  keyframe->initial_views = MatchedViews(problem, sources);
  keyframe->times += estimator_.last_times();
  return {std::move(problem), sources.Ids(), keyframe->pose.placed, keyframe->times};
}

KeyframeRefinement KeyframeEstimator::Begin(const WindowKeyframePtr& keyframe, const SourceViews& sources,
                                            bool lacks_future_views) {
  KeyframeRefinement refinement;
  refinement.keyframe = keyframe;
  refinement.sources = sources;
  refinement.problem = MakeProblem(keyframe.get(), sources);
  refinement.problem.reference.estimate = keyframe->initial;
  refinement.lacks_future_views = lacks_future_views;
  refinement.times = keyframe->times;
  return refinement;
}

void KeyframeEstimator::Step(size_t step, KeyframeRefinement* refinement) {
  EngineProblem problem = refinement->problem;
  const KeyframeStep& kind = estimator_.schedule()[step];
  if (kind.kind == KeyframeStep::Kind::kFillUnverified) {
    if (refinement->lacks_future_views) refinement->after_passes = problem.reference.estimate;
    ReadEstimates(refinement->sources, &WindowKeyframe::EstimateAfterPasses, &problem);
  } else {
    ReadEstimates(refinement->sources, &WindowKeyframe::EstimateForPasses, &problem);
  }
  refinement->problem.reference.estimate.reset();  // a pass continues in memory that nobody else holds
  refinement->problem.reference.estimate = estimator_.Run(kind, std::move(problem));
  refinement->times += estimator_.last_times();
  refinement->prior_depth_rejection = estimator_.prior_depth_rejection();
}

void KeyframeEstimator::KeepInstant(KeyframeRefinement* refinement) {
  const SourceViews& sources = refinement->sources;
  if (sources.num_of_capture == 0 || sources.num_of_capture == sources.keyframes.size()) return;
  EngineProblem own = refinement->problem;
  own.sources.resize(sources.num_of_capture);
  const EngineEstimatePtr matched = own.reference.estimate;
  own.reference.estimate.reset();
  const EngineEstimatePtr instant = estimator_.Run(estimator_.schedule().front(), own);
  refinement->times += estimator_.last_times();
  std::vector<InstantView> views;
  for (size_t i = 0; i < own.sources.size(); ++i) {
    const EngineEstimatePtr& estimate = sources.keyframes[i]->EstimateForPasses();
    if (estimate) views.push_back({own.sources[i], engine_->DownloadDepth(estimate)});
  }
  const Image<unsigned char> moved =
      FindMovedPixels(own.reference, views, engine_->DownloadDepth(matched), engine_->DownloadDepth(instant));
  if (std::none_of(moved.begin(), moved.end(), [](unsigned char m) { return m != 0; })) return;
  EstimateState state = engine_->DownloadState(matched);
  const EstimateState of_instant = engine_->DownloadState(instant);
  for (size_t i = 0; i < moved.size(); ++i) {
    if (moved.data()[i] == 0) continue;
    state.planes.data()[i] = of_instant.planes.data()[i];
    state.cost.data()[i] = of_instant.cost.data()[i];
  }
  refinement->problem.reference.estimate = engine_->UploadState(std::move(state), own.reference.frame->camera);
}

FinishedEstimate KeyframeEstimator::Finish(KeyframeRefinement refinement) {
  KeepInstant(&refinement);
  WindowKeyframe& keyframe = *refinement.keyframe;
  EngineProblem& problem = refinement.problem;
  ReadEstimates(refinement.sources, &WindowKeyframe::EstimateAfterPasses, &problem);
  // Without its future views others read the maps from before the last filling. Filled pixels confirm nothing, so
  // theirs would be filled there, too, and so on from keyframe to keyframe.
  keyframe.refined = refinement.after_passes ? refinement.after_passes : problem.reference.estimate;
  keyframe.lacks_future_views = refinement.lacks_future_views;
  keyframe.refined_score = refinement.sources.score;
  keyframe.refined_views = MatchedViews(problem, refinement.sources);
  keyframe.times = StageTimes();
  if (!refinement.lacks_future_views) keyframe.initial.reset();
  return {std::move(problem), refinement.sources.Ids(), keyframe.pose.placed, refinement.times,
          std::move(refinement.prior_depth_rejection)};
}

}  // namespace acmp
