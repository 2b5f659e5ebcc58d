#include "keyframe_estimator.h"

#include <utility>

namespace acmp {
namespace {

using Read = const EngineEstimatePtr& (WindowKeyframe::*)() const;

void ReadEstimates(const SourceViews& sources, Read estimate, EngineProblem* problem) {
  for (size_t i = 0; i < sources.keyframes.size(); ++i) {
    problem->sources[i].estimate = (*sources.keyframes[i].*estimate)();
  }
}

}  // namespace

EngineView KeyframeEstimator::MakeView(WindowKeyframe* keyframe) {
  const int levels = estimator_.options().start_level;
  if (!keyframe->image || keyframe->image_levels < levels) {
    keyframe->image = engine_->Load(keyframe->frame, levels);
    keyframe->image_levels = levels;
  }
  return {keyframe->frame, keyframe->image, nullptr};
}

EngineProblem KeyframeEstimator::MakeProblem(WindowKeyframe* keyframe, const SourceViews& sources) {
  EngineProblem problem;
  problem.reference = MakeView(keyframe);
  for (const WindowKeyframePtr& source : sources.keyframes) problem.sources.push_back(MakeView(source.get()));
  problem.depth_range = keyframe->range;
  return problem;
}

FinishedEstimate KeyframeEstimator::Initialise(WindowKeyframe* keyframe, const SourceViews& sources) {
  EngineProblem problem = MakeProblem(keyframe, sources);
  problem.reference.estimate = estimator_.Run(estimator_.schedule().front(), problem);
  keyframe->initial = problem.reference.estimate;
  keyframe->initial_score = sources.score;
  keyframe->times += estimator_.last_times();
  return {std::move(problem), sources.Ids(), keyframe->times};
}

FinishedEstimate KeyframeEstimator::Refine(WindowKeyframe* keyframe, const SourceViews& sources,
                                           const EngineEstimatePtr& start, bool lacks_future_views) {
  EngineProblem problem = MakeProblem(keyframe, sources);
  problem.reference.estimate = start;
  ReadEstimates(sources, &WindowKeyframe::EstimateForPasses, &problem);
  StageTimes times = keyframe->times;
  EngineEstimatePtr after_passes;
  const std::vector<KeyframeStep>& steps = estimator_.schedule();
  for (size_t i = 1; i < steps.size(); ++i) {
    if (steps[i].kind == KeyframeStep::Kind::kFillUnverified) {
      if (lacks_future_views) after_passes = problem.reference.estimate;
      ReadEstimates(sources, &WindowKeyframe::EstimateAfterPasses, &problem);
    }
    EngineProblem next = problem;
    problem.reference.estimate.reset();  // a pass continues in memory that nobody else holds
    problem.reference.estimate = estimator_.Run(steps[i], std::move(next));
    times += estimator_.last_times();
  }
  ReadEstimates(sources, &WindowKeyframe::EstimateAfterPasses, &problem);
  // A filled pixel confirms nothing, and what nothing confirms is filled: where few views see a place, as the last
  // keyframes do, filled pixels would spread from one to the next.
  keyframe->refined = after_passes ? after_passes : problem.reference.estimate;
  keyframe->lacks_future_views = lacks_future_views;
  keyframe->refined_score = sources.score;
  keyframe->refined_at = ++refinements_;
  keyframe->times = StageTimes();
  if (!lacks_future_views) keyframe->initial.reset();
  return {std::move(problem), sources.Ids(), times};
}

}  // namespace acmp
