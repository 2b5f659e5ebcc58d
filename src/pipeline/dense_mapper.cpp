#include "acmp_mapping/pipeline/dense_mapper.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <new>
#include <optional>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "dense_mapper_views.h"

namespace acmp {
namespace {

static_assert(kMaxRankedViews == kMaxSourceViews, "the selector must not rank more views than the matcher takes");

/// One keyframe of the window. A finished one stays as a source view of others until it is evicted.
struct WindowEntry {
  enum class State {
    kPending,   ///< waits for source views
    kFast,      ///< has its initial estimate, waits for later keyframes
    kFinished,  ///< on_refined or on_drop was called
  };
  FramePtr frame;
  DepthRange range;
  State state = State::kPending;
  EngineImagePtr image;        ///< null until the entry is first used as reference or source view
  int image_levels = 0;        ///< levels it was loaded with
  KeyframeDepthPtr latest;     ///< null before the initial estimate
  EngineEstimatePtr estimate;  ///< the same on the device, for the geometric passes of this and other keyframes
};

struct Failure {
  std::string reason;
  std::string message;
};

/// Runs `work`; what it throws becomes a value, so that one keyframe's failure does not reach the others.
template <class Work>
std::optional<Failure> CatchFailure(const Work& work) {
  try {
    work();
    return std::nullopt;
  } catch (const InvalidInputError& error) {
    return Failure{"invalid_input", error.what()};
  } catch (const std::bad_alloc&) {
    return Failure{"processing_error", "out of memory"};
  } catch (const std::exception& error) {
    return Failure{"processing_error", error.what()};
  }
}

/// MakeFrame guarantees this; frames from elsewhere must not reach the kernels with sizes that do not fit.
void CheckFrame(const Frame& frame) {
  const std::string name = Concat("keyframe ", frame.id);
  CheckCamera(name.c_str(), frame.camera);
  CheckPose(name.c_str(), frame.cam_from_world);
  const auto fits = [&](int width, int height) { return width == frame.camera.width && height == frame.camera.height; };
  if (!fits(frame.gray.width(), frame.gray.height()) ||
      !(frame.color.empty() || fits(frame.color.width(), frame.color.height()))) {
    throw InvalidInputError(Concat(
        name, ": image sizes ", frame.gray.width(), " x ", frame.gray.height(), " (grey), ", frame.color.width(), " x ",
        frame.color.height(), " (colour): must be the camera's, ", frame.camera.width, " x ", frame.camera.height));
  }
}

/// Middle of the range in the logarithm: a depth that is as many times the nearest as the farthest is of it.
double TypicalDepth(const DepthRange& range) { return std::sqrt(static_cast<double>(range.min) * range.max); }

}  // namespace

void Validate(const DenseMapperOptions& options) {
  Validate(options.pipeline);
  Validate(options.source_views);
  Validate(options.depth_range);
  const DepthRange& fallback = options.fallback_depth_range;
  if (!(fallback.min == 0 && fallback.max == 0)) CheckDepthRange("fallback_depth_range", fallback);
  CheckRange("window_size", options.window_size, 2, 64);
  CheckRange("lookahead", options.lookahead, 0, options.window_size - 1);
  CheckRange("min_source_views", options.min_source_views, 1,
             std::min(options.source_views.max_source_views, options.window_size - 1));
}

struct DenseMapper::Impl {
  /// Source views of one keyframe, best first.
  struct Sources {
    std::vector<WindowEntry*> entries;
    std::vector<int64_t> ids;
  };

  Impl(DepthEngine* depth_engine, const DenseMapperOptions& mapper_options, Callbacks mapper_callbacks)
      : options(mapper_options),
        callbacks(std::move(mapper_callbacks)),
        engine(depth_engine),
        estimator(depth_engine, options.pipeline) {}

  void Admit(FramePtr frame);
  std::optional<DepthRange> FindDepthRange(const Frame& frame);
  void EstimatePending(int min_source_views);
  void RefineOlderThan(size_t later_keyframes);
  void EvictUntil(int keyframes_left);

  std::vector<WindowEntry*> Others(const WindowEntry& entry);
  Sources SelectSources(const WindowEntry& entry);
  std::string DescribeMissing(const WindowEntry& entry, int min_source_views);

  EngineView MakeView(WindowEntry* entry);
  EngineProblem MakeProblem(WindowEntry* entry, const Sources& sources);
  std::shared_ptr<KeyframeDepth> MakeKeyframeDepth(const WindowEntry& entry, const EngineEstimatePtr& estimate,
                                                   std::vector<int64_t> source_ids);

  void Estimate(WindowEntry* entry, const Sources& sources);
  void Refine(WindowEntry* entry);
  KeyframeDepthPtr MakeRefined(WindowEntry* entry, const Sources& sources, EngineEstimatePtr* estimate);
  void Drop(WindowEntry* entry, const std::string& reason, const std::string& message);
  void Report(const KeyframeDrop& drop) const;

  DenseMapperOptions options;
  Callbacks callbacks;
  DepthEngine* engine;
  DepthEstimator estimator;
  std::deque<WindowEntry> window;  ///< oldest first; references stay valid while entries are added at the end
  std::optional<DepthRange> last_range;
  std::optional<int64_t> last_id;
};

void DenseMapper::Impl::Report(const KeyframeDrop& drop) const {
  if (callbacks.on_drop) callbacks.on_drop(drop);
}

void DenseMapper::Impl::Drop(WindowEntry* entry, const std::string& reason, const std::string& message) {
  entry->state = WindowEntry::State::kFinished;
  Report({entry->frame->id, reason, message, entry->latest != nullptr});
}

std::optional<DepthRange> DenseMapper::Impl::FindDepthRange(const Frame& frame) {
  if (const auto range =
          DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world, options.depth_range)) {
    last_range = range;
    return range;
  }
  if (last_range) return last_range;
  if (options.fallback_depth_range.max > 0) return options.fallback_depth_range;
  return std::nullopt;
}

void DenseMapper::Impl::Admit(FramePtr frame) {
  if (const auto failure = CatchFailure([&] { CheckFrame(*frame); })) {
    // Not kept: as a source view it would make the others fail as well.
    Report({frame->id, failure->reason, failure->message});
    return;
  }
  EvictUntil(options.window_size - 1);
  window.push_back({});
  WindowEntry& entry = window.back();
  entry.frame = std::move(frame);
  const std::optional<DepthRange> range = FindDepthRange(*entry.frame);
  if (range) {
    entry.range = *range;
    return;
  }
  Drop(&entry, "no_depth_range",
       Concat("keyframe ", entry.frame->id, ": of its ", entry.frame->landmarks_in_world.size(),
              " landmarks fewer than ", options.depth_range.min_landmarks,
              " are usable and in view, no earlier keyframe had a depth range, and no fallback range is set"));
}

std::vector<WindowEntry*> DenseMapper::Impl::Others(const WindowEntry& entry) {
  std::vector<WindowEntry*> others;
  for (WindowEntry& other : window) {
    if (&other != &entry) others.push_back(&other);
  }
  return others;
}

DenseMapper::Impl::Sources DenseMapper::Impl::SelectSources(const WindowEntry& entry) {
  const std::vector<WindowEntry*> others = Others(entry);
  std::vector<FramePtr> candidates;
  candidates.reserve(others.size());
  for (const WindowEntry* other : others) candidates.push_back(other->frame);
  Sources sources;
  for (const RankedSourceView& view :
       SelectSourceViews(*entry.frame, candidates, TypicalDepth(entry.range), options.source_views)) {
    sources.entries.push_back(others[view.index]);
    sources.ids.push_back(candidates[view.index]->id);
  }
  return sources;
}

std::string DenseMapper::Impl::DescribeMissing(const WindowEntry& entry, int min_source_views) {
  std::vector<FramePtr> candidates;
  for (const WindowEntry* other : Others(entry)) candidates.push_back(other->frame);
  const SourceViewCounts counts =
      CountSourceViews(*entry.frame, candidates, TypicalDepth(entry.range), options.source_views);
  return Concat("keyframe ", entry.frame->id, ": ",
                DescribeMissingViews(counts, min_source_views, options.source_views));
}

void DenseMapper::Impl::EstimatePending(int min_source_views) {
  for (WindowEntry& entry : window) {
    if (entry.state != WindowEntry::State::kPending) continue;
    const Sources sources = SelectSources(entry);
    if (sources.ids.size() >= static_cast<size_t>(min_source_views)) Estimate(&entry, sources);
  }
}

EngineView DenseMapper::Impl::MakeView(WindowEntry* entry) {
  const int levels = options.pipeline.start_level;
  if (!entry->image || entry->image_levels < levels) {
    entry->image = engine->Load(entry->frame, levels);
    entry->image_levels = levels;
  }
  return {entry->frame, entry->image, entry->estimate};
}

EngineProblem DenseMapper::Impl::MakeProblem(WindowEntry* entry, const Sources& sources) {
  EngineProblem problem;
  problem.reference = MakeView(entry);
  for (WindowEntry* source : sources.entries) problem.sources.push_back(MakeView(source));
  problem.depth_range = entry->range;
  return problem;
}

std::shared_ptr<KeyframeDepth> DenseMapper::Impl::MakeKeyframeDepth(const WindowEntry& entry,
                                                                    const EngineEstimatePtr& estimate,
                                                                    std::vector<int64_t> source_ids) {
  EstimateMaps estimate_maps = engine->Download(estimate);
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = entry.frame;
  maps->range = entry.range;
  maps->depth = std::move(estimate_maps.depth);
  maps->normal = std::move(estimate_maps.normal);
  maps->cost = std::move(estimate_maps.cost);
  maps->source_ids = std::move(source_ids);
  return maps;
}

void DenseMapper::Impl::Estimate(WindowEntry* entry, const Sources& sources) {
  EngineEstimatePtr estimate;
  std::shared_ptr<KeyframeDepth> maps;
  const auto failure = CatchFailure([&] {
    estimate = estimator.EstimateInitial(MakeProblem(entry, sources));
    maps = MakeKeyframeDepth(*entry, estimate, sources.ids);
    maps->times = estimator.last_times();
  });
  if (failure) return Drop(entry, failure->reason, failure->message);
  entry->state = WindowEntry::State::kFast;
  entry->estimate = std::move(estimate);
  entry->latest = maps;
  if (callbacks.on_fast) callbacks.on_fast(entry->latest);
}

void DenseMapper::Impl::RefineOlderThan(size_t later_keyframes) {
  for (size_t i = 0; i + later_keyframes < window.size(); ++i) {
    if (window[i].state == WindowEntry::State::kFast) Refine(&window[i]);
  }
}

void DenseMapper::Impl::Refine(WindowEntry* entry) {
  const Sources sources = SelectSources(*entry);
  // Its first views may have left the window meanwhile.
  if (sources.ids.empty()) return Drop(entry, "no_source_views", DescribeMissing(*entry, 1));
  EngineEstimatePtr estimate;
  KeyframeDepthPtr refined;
  const auto failure = CatchFailure([&] { refined = MakeRefined(entry, sources, &estimate); });
  if (failure) return Drop(entry, failure->reason, failure->message);
  entry->state = WindowEntry::State::kFinished;
  entry->estimate = std::move(estimate);
  entry->latest = refined;
  if (callbacks.on_refined) callbacks.on_refined(refined);
}

KeyframeDepthPtr DenseMapper::Impl::MakeRefined(WindowEntry* entry, const Sources& sources,
                                                EngineEstimatePtr* estimate) {
  EngineProblem problem = MakeProblem(entry, sources);
  StageTimes times = entry->latest->times;
  for (int step = 0; step < estimator.num_refinements(); ++step) {
    problem.reference.estimate = estimator.Refine(problem, step);
    times += estimator.last_times();
  }
  *estimate = problem.reference.estimate;
  std::shared_ptr<KeyframeDepth> refined = MakeKeyframeDepth(*entry, *estimate, sources.ids);

  Timer timer;
  ConsistencyResult consistency =
      engine->FilterByConsistency(problem.reference, problem.sources, options.pipeline.fusion);
  refined->confidence = std::move(consistency.confidence);
  refined->points_in_camera = std::move(consistency.points_in_camera);
  refined->consistency_ms = timer.Lap();
  refined->times = times;
  refined->refined = true;
  return refined;
}

void DenseMapper::Impl::EvictUntil(int keyframes_left) {
  while (window.size() > static_cast<size_t>(keyframes_left)) {
    WindowEntry& oldest = window.front();
    if (oldest.state == WindowEntry::State::kFast) Refine(&oldest);
    if (oldest.state == WindowEntry::State::kPending) {
      Drop(&oldest, "no_source_views", DescribeMissing(oldest, options.min_source_views));
    }
    window.pop_front();
  }
}

DenseMapper::DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  Validate(options);
  impl_ = std::make_unique<Impl>(engine, options, std::move(callbacks));
}

DenseMapper::~DenseMapper() = default;

void DenseMapper::set_options(const DenseMapperOptions& options) {
  Validate(options);
  impl_->options = options;
  impl_->estimator.set_options(options.pipeline);
}

void DenseMapper::AddKeyframe(FramePtr frame) {
  if (!frame) throw InvalidInputError("frame: must not be null");
  if (impl_->last_id && frame->id <= *impl_->last_id) {
    throw InvalidInputError(
        Concat("frame id = ", frame->id, ": must be above ", *impl_->last_id, ", the previous keyframe's"));
  }
  impl_->last_id = frame->id;
  impl_->EvictUntil(impl_->options.window_size);  // it may have shrunk
  impl_->Admit(std::move(frame));
  impl_->EstimatePending(impl_->options.min_source_views);
  impl_->RefineOlderThan(static_cast<size_t>(impl_->options.lookahead));
}

void DenseMapper::Flush() {
  impl_->EstimatePending(1);
  for (WindowEntry& entry : impl_->window) {
    if (entry.state != WindowEntry::State::kPending) continue;
    impl_->Drop(&entry, "no_source_views", impl_->DescribeMissing(entry, 1));
  }
  impl_->RefineOlderThan(0);
}

void DenseMapper::Reset() {
  // Emptied first: the mapper is in order even if a callback throws.
  std::deque<WindowEntry> window;
  window.swap(impl_->window);
  impl_->last_range.reset();
  impl_->last_id.reset();
  for (WindowEntry& entry : window) {
    if (entry.state == WindowEntry::State::kFinished) continue;
    impl_->Drop(&entry, "reset", Concat("keyframe ", entry.frame->id, ": forgotten by a reset"));
  }
}

size_t DenseMapper::unfinished() const {
  return static_cast<size_t>(std::count_if(impl_->window.begin(), impl_->window.end(), [](const WindowEntry& entry) {
    return entry.state != WindowEntry::State::kFinished;
  }));
}

}  // namespace acmp
