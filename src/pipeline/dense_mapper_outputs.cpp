// What becomes of finished estimates: their maps come to the host and go to the callbacks. Jobs touch what they were
// given, `callbacks`, the engine for outputs, and of a keyframe what says that a callback was called.

#include <utility>

#include "acmp_mapping/common/timer.h"
#include "dense_mapper_impl.h"

namespace acmp {
namespace {

std::string DescribeFailedAgain(int64_t id, const Failure& failure) {
  return Concat("keyframe ", id, " could not be refined again: ", failure.message);
}

}  // namespace

KeyframeDepthPtr DenseMapper::Impl::Finish(const EstimateOutput& output) const {
  const EngineEstimatePtr& estimate = output.problem.reference.estimate;
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = output.problem.reference.frame;
  maps->range = output.problem.depth_range;
  maps->source_ids = output.source_ids;
  maps->times = output.times;
  if (!output.consistency) {
    maps->depth = output_engine->DownloadDepth(estimate);
    return maps;
  }
  EstimateMaps estimate_maps = output_engine->Download(estimate);
  maps->depth = std::move(estimate_maps.depth);
  maps->normal = std::move(estimate_maps.normal);
  maps->cost = std::move(estimate_maps.cost);
  Timer timer;
  ConsistencyResult consistency =
      output_engine->FilterByConsistency(output.problem.reference, output.problem.sources, *output.consistency);
  maps->confidence = std::move(consistency.confidence);
  maps->points_in_camera = std::move(consistency.points_in_camera);
  maps->consistency_ms = timer.Lap();
  maps->refined = true;
  return maps;
}

void DenseMapper::Impl::SubmitFast(const WindowKeyframePtr& keyframe, EstimateOutput output) {
  outputs.Submit([this, keyframe, output = std::move(output)] {
    KeyframeDepthPtr maps;
    if (const auto failure = CatchFailure([&] { maps = Finish(output); })) {
      return CallProblem("fast_maps_failed",
                         Concat("keyframe ", keyframe->frame->id, " has no fast maps: ", failure->message));
    }
    keyframe->had_fast = true;
    if (callbacks.on_fast) callbacks.on_fast(maps);
  });
}

uint64_t DenseMapper::Impl::SubmitRefined(const WindowKeyframePtr& keyframe, EstimateOutput output) {
  return outputs.Submit([this, keyframe, output = std::move(output)] {
    KeyframeDepthPtr maps;
    if (const auto failure = CatchFailure([&] { maps = Finish(output); })) {
      if (!callbacks.on_drop) return;
      return callbacks.on_drop({keyframe->frame->id, failure->reason, failure->message, keyframe->had_fast});
    }
    keyframe->had_refined = true;
    if (callbacks.on_refined) callbacks.on_refined(maps);
  });
}

void DenseMapper::Impl::SubmitRefinedAgain(EstimateOutput output) {
  outputs.Submit([this, output = std::move(output)] {
    KeyframeDepthPtr maps;
    if (const auto failure = CatchFailure([&] { maps = Finish(output); })) {
      return CallProblem("refine_again_failed", DescribeFailedAgain(output.problem.reference.frame->id, *failure));
    }
    if (callbacks.on_refined_again) callbacks.on_refined_again(maps);
  });
}

void DenseMapper::Impl::SubmitDrop(KeyframeDrop drop, WindowKeyframePtr keyframe) {
  outputs.Submit([this, drop = std::move(drop), keyframe = std::move(keyframe)]() mutable {
    drop.had_fast = keyframe && keyframe->had_fast;
    if (callbacks.on_drop) callbacks.on_drop(drop);
  });
}

void DenseMapper::Impl::ReportFailedAgain(int64_t id, const Failure& failure) {
  ReportProblem("refine_again_failed", DescribeFailedAgain(id, failure));
}

void DenseMapper::Impl::ReportProblem(const char* reason, std::string message) {
  outputs.Submit([this, reason, message = std::move(message)] { CallProblem(reason, message); });
}

void DenseMapper::Impl::CallProblem(const char* reason, const std::string& message) const {
  if (callbacks.on_problem) callbacks.on_problem(reason, message);
}

}  // namespace acmp
