#include "mapper_outputs.h"

#include <utility>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/fusion/label_votes.h"

namespace acmp {
namespace {

void Scale(float scale, DepthMap* depths) {
  if (scale == 1) return;
  for (float& depth : *depths) depth *= scale;
}

void Scale(float scale, PointCloud* points) {
  if (scale == 1) return;
  for (SurfacePoint& point : *points) point.position = scale * point.position;
}

std::shared_ptr<KeyframeDepth> MakeWithoutMaps(const KeyframeSteps& steps) {
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = steps.problem.reference.frame;
  const DepthRange& range = steps.problem.depth_range;
  maps->cam_from_world = maps->frame->cam_from_world;
  if (const auto& refined = steps.refined) {
    maps->cam_from_world = refined->placed;
    maps->refined_camera = RefinedCamera{refined->world, refined->cam_from_world.inverse(), refined->scale};
  }
  maps->pose_fit = steps.pose_fit;
  maps->range = {steps.scale() * range.min, steps.scale() * range.max};
  maps->source_ids = steps.sources.Ids();
  maps->times = steps.times;
  maps->prior_depth_rejection = steps.prior_depth_rejection;
  return maps;
}

/// Those that have labels.
std::vector<LabeledView> LabeledViewsOf(const EngineProblem& problem, DepthEngine* engine) {
  std::vector<LabeledView> views;
  const auto add = [&](const EngineView& view, bool is_own) {
    if (view.frame->labels.empty() || !view.estimate) return;
    views.push_back({{view.frame->camera, view.cam_from_world()},
                     &view.frame->labels,
                     engine->DownloadDepth(view.estimate),
                     is_own});
  };
  add(problem.reference, true);
  for (const EngineView& source : problem.sources) add(source, false);
  return views;
}

/// Which checks leave no point of the reference. Estimates are fetched for it, so it takes many times as long as the
/// checks.
PointLosses FindPointLosses(const EngineProblem& problem, const FusionOptions& consistency, DepthEngine* engine) {
  constexpr int kStep = 4;
  HostDepthEngine host;
  const auto on_host = [&](EngineView view) {
    if (view.estimate) view.estimate = host.UploadState(engine->DownloadState(view.estimate), view.frame->camera);
    return view;
  };
  std::vector<EngineView> sources;
  for (const EngineView& source : problem.sources) sources.push_back(on_host(source));
  return host.CountLosses(on_host(problem.reference), sources, consistency, kStep);
}

}  // namespace

OutputQueue::OutputQueue(bool has_thread) {
  if (has_thread) thread_ = std::thread([this] { Run(); });
}

OutputQueue::~OutputQueue() {
  std::deque<Job> discarded;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
    discarded.swap(jobs_);
  }
  discarded.clear();  // without the lock: jobs may own anything
  given_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void OutputQueue::Submit(Job job) {
  if (!thread_.joinable()) return job();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(std::move(job));
    ++unfinished_;
  }
  given_.notify_one();
  WaitForFewerThan(kMaxJobs);
}

void OutputQueue::WaitForAll() { WaitForFewerThan(1); }

void OutputQueue::WaitForFewerThan(size_t jobs) {
  std::unique_lock<std::mutex> lock(mutex_);
  done_.wait(lock, [&] { return unfinished_ < jobs; });
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void OutputQueue::Run() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    given_.wait(lock, [this] { return stopped_ || !jobs_.empty(); });
    if (stopped_) return;
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    std::exception_ptr failure;
    try {
      job();
    } catch (...) {
      failure = std::current_exception();
    }
    job = nullptr;  // what it holds goes before its giver hears that it is done
    lock.lock();
    if (!failure_) failure_ = failure;
    --unfinished_;
    done_.notify_one();
  }
}

Failure ForgottenByReset(const Frame& frame) {
  return {"reset", Concat("keyframe ", frame.id, ": forgotten by a reset")};
}

std::string DescribeFailedAgain(int64_t id, const Failure& failure) {
  return Concat("keyframe ", id, " could not be refined again: ", failure.message);
}

MapperOutputs::MapperOutputs(DepthEngine* engine, bool has_thread, DenseMapper::Callbacks callbacks, StopRequest* stop)
    : engine_(engine), callbacks_(std::move(callbacks)), stop_(stop), queue_(has_thread) {
  const auto fill_empty = [](auto&... functions) {
    ((functions = functions ? functions : [](const auto&...) {}), ...);
  };
  DenseMapper::Callbacks& c = callbacks_;
  fill_empty(c.on_fast, c.on_refined, c.on_refined_again, c.on_withdrawn, c.on_drop, c.on_problem);
}

KeyframeDepthPtr MapperOutputs::MakeFast(const KeyframeSteps& steps) const {
  auto maps = MakeWithoutMaps(steps);
  maps->depth = engine_->DownloadDepth(steps.problem.reference.estimate);
  Scale(steps.scale(), &maps->depth);
  return maps;
}

KeyframeDepthPtr MapperOutputs::MakeRefined(const KeyframeSteps& steps, const FusionOptions& consistency) {
  auto maps = MakeWithoutMaps(steps);
  EstimateMaps estimate_maps = engine_->Download(steps.problem.reference.estimate);
  maps->depth = std::move(estimate_maps.depth);
  Scale(steps.scale(), &maps->depth);
  maps->normal = std::move(estimate_maps.normal);
  maps->cost = std::move(estimate_maps.cost);
  Timer timer;
  ConsistencyResult result = engine_->FilterByConsistency(steps.problem.reference, steps.problem.sources, consistency);
  maps->confidence = std::move(result.confidence);
  maps->points_in_camera = std::move(result.points_in_camera);
  const EngineView& reference = steps.problem.reference;
  VoteForLabels(LabeledViewsOf(steps.problem, engine_), {reference.frame->camera, reference.cam_from_world()},
                consistency.max_relative_depth, &maps->points_in_camera);
  Scale(steps.scale(), &maps->points_in_camera);
  maps->consistency_ms = timer.Lap();
  without_points_ = maps->points_in_camera.empty() ? without_points_ + 1 : 0;
  if (without_points_ % kLossesPeriod == 1) {
    no_points_reason_ = Describe(FindPointLosses(steps.problem, consistency, engine_), consistency);
  }
  if (without_points_ > 0) maps->no_points_reason = no_points_reason_;
  maps->refined = true;
  return maps;
}

void MapperOutputs::SubmitFast(KeyframeSteps steps) {
  queue_.Submit([this, steps = std::move(steps)] {
    KeyframeDepthPtr maps;
    if (const auto failure = CatchFailure([&] { maps = MakeFast(steps); })) {
      return callbacks_.on_problem(
          "fast_maps_failed", Concat("keyframe ", steps.keyframe->frame->id, " has no fast maps: ", failure->message));
    }
    steps.keyframe->had_fast = true;
    callbacks_.on_fast(maps);
  });
}

void MapperOutputs::SubmitRefined(KeyframeSteps steps, const FusionOptions& consistency, bool again) {
  const bool was_withdrawn = steps.keyframe->is_withdrawn.exchange(false);
  queue_.Submit([this, consistency, again, was_withdrawn, steps = std::move(steps)] {
    const WindowKeyframePtr& keyframe = steps.keyframe;
    if (again && !keyframe->had_refined) return;  // it was dropped
    KeyframeDepthPtr maps;
    auto failure = CatchFailure([&] { stop_->RunCancellable([&] { maps = MakeRefined(steps, consistency); }); });
    if (stop_->requested()) failure = ForgottenByReset(*keyframe->frame);
    if (failure) {
      if (was_withdrawn) keyframe->is_withdrawn = true;
      if (again)
        return callbacks_.on_problem("refine_again_failed", DescribeFailedAgain(keyframe->frame->id, *failure));
      return callbacks_.on_drop({keyframe->frame, failure->reason, failure->message, keyframe->had_fast});
    }
    keyframe->had_refined = true;
    (again ? callbacks_.on_refined_again : callbacks_.on_refined)(maps);
  });
}

void MapperOutputs::SubmitWithdrawal(const WindowKeyframePtr& keyframe, const std::string& message) {
  queue_.Submit([this, keyframe, message] {
    if (!keyframe->had_refined) return;
    auto maps = std::make_shared<KeyframeDepth>();
    maps->frame = keyframe->frame;
    maps->cam_from_world = keyframe->frame->cam_from_world;
    callbacks_.on_withdrawn(maps, message);
  });
}

void MapperOutputs::SubmitDrop(const FramePtr& frame, const Failure& failure, const WindowKeyframePtr& keyframe) {
  queue_.Submit([this, frame, failure, keyframe] {
    callbacks_.on_drop({frame, failure.reason, failure.message, keyframe && keyframe->had_fast});
  });
}

void MapperOutputs::SubmitProblem(const char* reason, const std::string& message) {
  queue_.Submit([this, reason, message] { callbacks_.on_problem(reason, message); });
}

}  // namespace acmp
