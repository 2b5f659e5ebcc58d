#include <algorithm>
#include <iterator>
#include <utility>

#include "dense_mapper_impl.h"

namespace acmp {
namespace {

const char* NameOf(EstimateStage stage) { return stage == EstimateStage::kFast ? "fast" : "refined"; }

}  // namespace

EngineView DenseMapper::Impl::MakeView(WindowKeyframe* keyframe) {
  const int levels = options.pipeline.start_level;
  if (!keyframe->image || keyframe->image_levels < levels) {
    keyframe->image = engine->Load(keyframe->frame, levels);
    keyframe->image_levels = levels;
  }
  return {keyframe->frame, keyframe->image, nullptr};
}

EngineProblem DenseMapper::Impl::MakeInitialProblem(WindowKeyframe* keyframe, const Sources& sources) {
  EngineProblem problem;
  problem.reference = MakeView(keyframe);
  for (const WindowKeyframePtr& source : sources.keyframes) problem.sources.push_back(MakeView(source.get()));
  problem.depth_range = keyframe->range;
  return problem;
}

void DenseMapper::Impl::Estimate(const WindowKeyframePtr& keyframe, const Sources& sources) {
  EngineProblem problem;
  const auto failure = CatchFailure([&] {
    problem = MakeInitialProblem(keyframe.get(), sources);
    problem.reference.estimate = estimator.EstimateInitial(problem);
    Publish(*keyframe, EstimateStage::kFast, problem.reference.estimate);
  });
  if (failure) {
    keyframe->stage.reset();
    return Drop(keyframe, failure->reason, failure->message);
  }
  keyframe->times = estimator.last_times();
  keyframe->fast = problem.reference.estimate;
  keyframe->fast_settled = true;
  SubmitFast(keyframe, {std::move(problem), sources.ids, *keyframe->times, {}});
}

/// Others read what comes of it from now on. Where it fails they go on with what they read before.
void DenseMapper::Impl::Reestimate(WindowKeyframe* keyframe, const Sources& sources) {
  keyframe->tried_score = sources.score;
  EngineEstimatePtr estimate;
  const auto failure =
      CatchFailure([&] { estimate = estimator.EstimateInitial(MakeInitialProblem(keyframe, sources)); });
  if (failure) {
    return ReportProblem("reestimate_failed",
                         Concat("keyframe ", keyframe->frame->id, " could not be estimated anew: ", failure->message));
  }
  if (keyframe->times) *keyframe->times += estimator.last_times();
  keyframe->views_score = sources.score;
  keyframe->fast = std::move(estimate);
  keyframe->refined.reset();
  keyframe->stage = EstimateStage::kFast;
}

bool DenseMapper::Impl::IsReady(const ScheduledRefinement& refinement) const {
  return std::all_of(refinement.sources.begin(), refinement.sources.end(), [this](const auto& source) {
    return !source.Missing() || lost_shards.count(source.keyframe->shard) > 0;
  });
}

void DenseMapper::Impl::RunReady() {
  for (;;) {
    const auto ready =
        std::find_if(waiting.begin(), waiting.end(), [this](const auto& refinement) { return IsReady(refinement); });
    if (ready == waiting.end()) return;
    const ScheduledRefinement refinement = std::move(*ready);
    waiting.erase(ready);
    Refine(refinement);
  }
}

void DenseMapper::Impl::Refine(const ScheduledRefinement& refinement) {
  WindowKeyframe& keyframe = *refinement.keyframe;
  EngineEstimatePtr estimate;
  EstimateOutput output;
  const auto failure = CatchFailure([&] {
    output = MakeRefined(refinement, keyframe.fast, &estimate);
    Publish(keyframe, EstimateStage::kRefined, estimate);
  });
  if (failure) return Drop(refinement.keyframe, failure->reason, failure->message);
  keyframe.refined = std::move(estimate);
  keyframe.refined_settled = true;
  keyframe.refined_score = refinement.score;
  keyframe.refined_at = ++refinements;
  keyframe.times = StageTimes();
  // With several shards a refinement that waits may still have to read the fast one.
  if (shard.count == 1 && !keyframe.few_later) keyframe.fast.reset();
  keyframe.output = SubmitRefined(refinement.keyframe, std::move(output));
}

/// False where that fails; the keyframe's maps stay as they are then.
bool DenseMapper::Impl::RunAgain(const ScheduledRefinement& refinement, const EngineEstimatePtr& start) {
  WindowKeyframe& keyframe = *refinement.keyframe;
  EngineEstimatePtr estimate;
  EstimateOutput output;
  const auto failure = CatchFailure([&] { output = MakeRefined(refinement, start, &estimate); });
  if (failure) {
    ReportFailedAgain(keyframe.frame->id, *failure);
    return false;
  }
  keyframe.refined = std::move(estimate);
  keyframe.stage = EstimateStage::kRefined;
  keyframe.refined_score = refinement.score;
  keyframe.refined_at = ++refinements;
  keyframe.times = StageTimes();
  if (!keyframe.few_later) keyframe.fast.reset();
  SubmitRefinedAgain(std::move(output));
  return true;
}

EngineProblem DenseMapper::Impl::MakeRefinementProblem(const ScheduledRefinement& refinement) {
  const WindowKeyframe& keyframe = *refinement.keyframe;
  EngineProblem problem;
  problem.reference = MakeView(refinement.keyframe.get());
  problem.depth_range = keyframe.range;
  for (const ScheduledRefinement::Source& source : refinement.sources) {
    problem.sources.push_back(MakeView(source.keyframe.get()));
    const auto missing = source.Missing();
    if (!missing) continue;
    ReportProblem("peer_estimate_missing",
                  Concat("keyframe ", keyframe.frame->id, " is refined without the ", NameOf(*missing),
                         " estimate of keyframe ", source.keyframe->frame->id, ", which shard ", source.keyframe->shard,
                         " of ", shard.count, " did not send in time"));
  }
  return problem;
}

EstimateOutput DenseMapper::Impl::MakeRefined(const ScheduledRefinement& refinement, const EngineEstimatePtr& start,
                                              EngineEstimatePtr* for_others) {
  EngineProblem problem = MakeRefinementProblem(refinement);
  problem.reference.estimate = start;
  const auto read = [&](std::optional<EstimateStage> ScheduledRefinement::Source::*stage) {
    for (size_t i = 0; i < problem.sources.size(); ++i) {
      const ScheduledRefinement::Source& source = refinement.sources[i];
      problem.sources[i].estimate = source.*stage ? source.keyframe->Estimate(*(source.*stage)) : nullptr;
    }
  };
  StageTimes times = *refinement.keyframe->times;
  const auto run = [&](int step) {
    EngineProblem next = problem;
    problem.reference.estimate.reset();  // a pass continues in memory that nobody else holds
    problem.reference.estimate = estimator.Refine(std::move(next), step);
    times += estimator.last_times();
  };
  const int steps = estimator.num_refinements();
  const int steps_in_passes = NumRefinementsInPasses(options.pipeline);
  read(&ScheduledRefinement::Source::in_passes);
  for (int step = 0; step < steps_in_passes; ++step) run(step);
  *for_others = problem.reference.estimate;
  read(&ScheduledRefinement::Source::after_passes);
  for (int step = steps_in_passes; step < steps; ++step) run(step);
  // A completed pixel confirms nothing, and what nothing confirms is completed: where few views see a place, as the
  // last keyframes do, completed pixels would spread from one to the next.
  if (!refinement.keyframe->few_later) *for_others = problem.reference.estimate;
  return {std::move(problem), refinement.source_ids, times, options.pipeline.fusion};
}

void DenseMapper::Impl::Publish(const WindowKeyframe& keyframe, EstimateStage stage,
                                const EngineEstimatePtr& estimate) {
  if (shard.count == 1 || !callbacks.on_own_estimate) return;
  // A std::function must be copyable.
  const auto own = std::make_shared<ShardEstimate>();
  *own = {keyframe.frame->id, stage, estimate ? engine->DownloadState(estimate) : EstimateState()};
  outputs.Submit([this, own] { callbacks.on_own_estimate(std::move(*own)); });
}

void DenseMapper::Impl::AdmitPeer(const WindowKeyframePtr& keyframe) {
  for (auto old = peer_keyframes.begin(); old != peer_keyframes.end();) {
    old = old->second.expired() ? peer_keyframes.erase(old) : std::next(old);
  }
  const int64_t id = keyframe->frame->id;
  peer_keyframes[id] = keyframe;
  for (auto [it, end] = early.equal_range(id); it != end; ++it) SettlePeer(keyframe.get(), std::move(it->second));
  early.erase(early.begin(), early.upper_bound(id));
}

void DenseMapper::Impl::SettlePeer(WindowKeyframe* keyframe, ShardEstimate estimate) {
  const bool fast = estimate.stage == EstimateStage::kFast;
  const bool none = estimate.state.planes.empty();
  // A keyframe without a fast estimate gets no refined one.
  if (fast) keyframe->fast_settled = true;
  if (!fast || none) keyframe->refined_settled = true;
  if (none) return;
  const auto failure = CatchFailure([&] {
    (fast ? keyframe->fast : keyframe->refined) =
        engine->UploadState(std::move(estimate.state), keyframe->frame->camera);
  });
  if (failure) {
    ReportProblem("peer_estimate_refused", Concat(NameOf(estimate.stage), " estimate of keyframe ", estimate.id,
                                                  " from shard ", keyframe->shard, ": ", failure->message));
  }
}

void DenseMapper::Impl::KeepForLater(ShardEstimate estimate) {
  early.emplace(estimate.id, std::move(estimate));
  // A peer is ahead by a window at most, unless it has given up on this shard: then the nearest ones are worth keeping.
  const size_t most = 2 * static_cast<size_t>(options.window_size) * static_cast<size_t>(shard.count);
  if (early.size() <= most) return;
  const auto last = std::prev(early.end());
  ReportProblem("peer_estimate_refused",
                Concat(NameOf(last->second.stage), " estimate of keyframe ", last->first, ": ", most,
                       " estimates of keyframes that have not come here are kept already"));
  early.erase(last);
}

}  // namespace acmp
