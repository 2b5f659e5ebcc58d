#include "acmp_mapping/pipeline/dense_mapper.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dense_mapper_impl.h"
#include "dense_mapper_views.h"

namespace acmp {
namespace {

static_assert(kMaxRankedViews == kMaxSourceViews, "the selector must not rank more views than the matcher takes");

/// What a keyframe sees last is seen well by those that come after it. Refined without them it errs there as its
/// neighbours do, from which it took that; passes that read it hand the error on from keyframe to keyframe, where fast
/// estimates err each in its own way. With two later keyframes the fast ones serve better, with five the refined ones
/// (docs/quality.md).
constexpr size_t kMinLaterKeyframes = 3;

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

std::vector<FrameLandmarksPtr> LandmarksOf(const std::vector<WindowKeyframePtr>& keyframes) {
  std::vector<FrameLandmarksPtr> landmarks;
  landmarks.reserve(keyframes.size());
  for (const WindowKeyframePtr& keyframe : keyframes) landmarks.push_back(keyframe->landmarks);
  return landmarks;
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
  CheckRange("window_size", options.window_size, 2, kMaxWindowSize);
  CheckRange("lookahead", options.lookahead, 0, options.window_size - 1);
  CheckRange("reestimates", options.reestimates, 0, options.window_size - 1);
  CheckRange("min_source_views", options.min_source_views, 1,
             std::min(options.source_views.max_source_views, options.window_size - 1));
}

void Validate(const ShardOptions& shard) {
  CheckRange("shard_count", shard.count, 1, kMaxShards);
  CheckRange("shard_index", shard.index, 0, shard.count - 1);
}

DenseMapper::Impl::Impl(DepthEngine* depth_engine, const DenseMapperOptions& mapper_options, Callbacks mapper_callbacks,
                        const ShardOptions& mapper_shard, DepthEngine* engine_of_outputs)
    : options(mapper_options),
      callbacks(std::move(mapper_callbacks)),
      shard(mapper_shard),
      engine(depth_engine),
      output_engine(engine_of_outputs != nullptr ? engine_of_outputs : depth_engine),
      estimator(depth_engine, options.pipeline),
      outputs(engine_of_outputs != nullptr) {}

int DenseMapper::Impl::ShardOf(int64_t id) const {
  const int remainder = static_cast<int>(id % shard.count);
  return remainder < 0 ? remainder + shard.count : remainder;
}

/// Of another shard's keyframe, that shard tells.
void DenseMapper::Impl::Drop(const WindowKeyframePtr& keyframe, const std::string& reason, const std::string& message) {
  keyframe->state = WindowKeyframe::State::kScheduled;
  if (!IsOwn(*keyframe)) return;
  const bool has_fast = keyframe->times.has_value();
  keyframe->fast_settled = keyframe->refined_settled = true;
  Publish(*keyframe, has_fast ? EstimateStage::kRefined : EstimateStage::kFast, nullptr);
  SubmitDrop({keyframe->frame->id, reason, message}, keyframe);
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

/// Whether it is in the window now.
bool DenseMapper::Impl::Admit(FramePtr frame) {
  const int64_t id = frame->id;
  if (const auto failure = CatchFailure([&] { CheckFrame(*frame); })) {
    // Not kept: as a source view it would make the others fail as well.
    early.erase(early.begin(), early.upper_bound(id));
    if (ShardOf(id) == shard.index) SubmitDrop({id, failure->reason, failure->message}, nullptr);
    return false;
  }
  EvictUntil(options.window_size - 1);
  const auto keyframe = std::make_shared<WindowKeyframe>();
  keyframe->landmarks = std::make_shared<FrameLandmarks>(frame);
  keyframe->frame = std::move(frame);
  keyframe->shard = ShardOf(id);
  window.push_back(keyframe);
  if (!IsOwn(*keyframe)) AdmitPeer(keyframe);
  if (const std::optional<DepthRange> range = FindDepthRange(*keyframe->frame)) {
    keyframe->range = *range;
    return true;
  }
  Drop(keyframe, "no_depth_range",
       Concat("keyframe ", id, ": of its ", keyframe->frame->landmarks_in_world.size(), " landmarks fewer than ",
              options.depth_range.min_landmarks,
              " are usable and in view, no earlier keyframe had a depth range, and no fallback range is set"));
  return true;
}

std::vector<WindowKeyframePtr> DenseMapper::Impl::Others(const WindowKeyframe& keyframe) const {
  std::vector<WindowKeyframePtr> others;
  for (const WindowKeyframePtr& other : window) {
    if (other.get() != &keyframe) others.push_back(other);
  }
  return others;
}

SourceViewSelector& DenseMapper::Impl::SelectorOf(WindowKeyframe* keyframe) const {
  if (!keyframe->selector) {
    keyframe->selector.emplace(keyframe->landmarks, TypicalDepth(keyframe->range), options.source_views);
  }
  return *keyframe->selector;
}

DenseMapper::Impl::Sources DenseMapper::Impl::SelectSources(WindowKeyframe* keyframe) const {
  const std::vector<WindowKeyframePtr> others = Others(*keyframe);
  Sources sources;
  for (const RankedSourceView& view : SelectorOf(keyframe).Select(LandmarksOf(others))) {
    sources.keyframes.push_back(others[view.index]);
    sources.ids.push_back(others[view.index]->frame->id);
    sources.score += view.score;
  }
  return sources;
}

std::string DenseMapper::Impl::DescribeMissing(WindowKeyframe* keyframe, int min_source_views) const {
  const SourceViewCounts counts = SelectorOf(keyframe).Count(LandmarksOf(Others(*keyframe)));
  return Concat("keyframe ", keyframe->frame->id, ": ",
                DescribeMissingViews(counts, min_source_views, options.source_views));
}

void DenseMapper::Impl::EstimatePending(int min_source_views) {
  for (const WindowKeyframePtr& keyframe : window) {
    if (keyframe->state != WindowKeyframe::State::kPending) continue;
    const Sources sources = SelectSources(keyframe.get());
    if (sources.ids.size() < static_cast<size_t>(min_source_views)) continue;
    keyframe->state = WindowKeyframe::State::kFast;
    keyframe->stage = EstimateStage::kFast;
    keyframe->views_score = sources.score;
    if (IsOwn(*keyframe)) Estimate(keyframe, sources);
  }
}

void DenseMapper::Impl::ScheduleOlderThan(size_t later_keyframes) {
  for (size_t i = 0; i + later_keyframes < window.size(); ++i) {
    if (window[i]->state == WindowKeyframe::State::kFast) Schedule(window[i]);
  }
}

bool DenseMapper::Impl::HasFewLater(const WindowKeyframe& keyframe) const {
  const auto later = std::count_if(window.begin(), window.end(), [&](const WindowKeyframePtr& other) {
    return other->frame->id > keyframe.frame->id;
  });
  return static_cast<size_t>(later) < kMinLaterKeyframes;
}

ScheduledRefinement DenseMapper::Impl::MakeRefinement(const WindowKeyframePtr& keyframe, Sources sources) const {
  ScheduledRefinement refinement;
  refinement.keyframe = keyframe;
  refinement.source_ids = std::move(sources.ids);
  refinement.score = sources.score;
  for (WindowKeyframePtr& source : sources.keyframes) {
    const auto in_passes = source->StageInPasses();
    const auto after_passes = source->stage;
    refinement.sources.push_back({std::move(source), in_passes, after_passes});
  }
  return refinement;
}

/// Gives the refinement its place in the order of all keyframes: what it reads is settled now, even if it runs later or
/// in another shard.
void DenseMapper::Impl::Schedule(const WindowKeyframePtr& keyframe) {
  Sources sources = SelectSources(keyframe.get());
  // Its first views may have left the window meanwhile.
  if (sources.ids.empty()) return Drop(keyframe, "no_source_views", DescribeMissing(keyframe.get(), 1));
  ScheduledRefinement refinement = MakeRefinement(keyframe, std::move(sources));
  keyframe->state = WindowKeyframe::State::kScheduled;
  keyframe->stage = EstimateStage::kRefined;
  keyframe->few_later = HasFewLater(*keyframe);
  if (!IsOwn(*keyframe)) return;
  waiting.push_back(std::move(refinement));
  RunReady();
}

void DenseMapper::Impl::EvictUntil(int keyframes_left) {
  while (window.size() > static_cast<size_t>(keyframes_left)) {
    const WindowKeyframePtr oldest = window.front();
    if (oldest->state == WindowKeyframe::State::kFast) Schedule(oldest);
    if (oldest->state == WindowKeyframe::State::kPending) {
      Drop(oldest, "no_source_views", DescribeMissing(oldest.get(), options.min_source_views));
    }
    if (CanBeRefinedAgain(*oldest)) leaving.push_back(oldest);
    window.pop_front();
  }
}

DenseMapper::DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks,
                         const ShardOptions& shard, DepthEngine* output_engine) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  if (output_engine == engine) throw InvalidInputError("output_engine: must not be the engine of the passes");
  Validate(options);
  Validate(shard);
  impl_ = std::make_unique<Impl>(engine, options, std::move(callbacks), shard, output_engine);
}

DenseMapper::~DenseMapper() = default;

void DenseMapper::set_options(const DenseMapperOptions& options) {
  Validate(options);
  const bool other_views = !(options.source_views == impl_->options.source_views);
  impl_->options = options;
  impl_->estimator.set_options(options.pipeline);
  if (other_views) impl_->ScoreViewsAnew();
}

/// Scores under other options cannot be compared: what is in the window now counts as what was used.
void DenseMapper::Impl::ScoreViewsAnew() {
  for (const WindowKeyframePtr& keyframe : window) {
    keyframe->selector.reset();
    keyframe->tried_score = 0;
    if (!keyframe->views_score) continue;
    const double score = SelectSources(keyframe.get()).score;
    keyframe->views_score = score;
    if (keyframe->refined_score) keyframe->refined_score = score;
  }
}

void DenseMapper::AddKeyframe(FramePtr frame) {
  if (!frame) throw InvalidInputError("frame: must not be null");
  if (impl_->last_id && frame->id <= *impl_->last_id) {
    throw InvalidInputError(
        Concat("frame id = ", frame->id, ": must be above ", *impl_->last_id, ", the previous keyframe's"));
  }
  impl_->last_id = frame->id;
  impl_->leaving.clear();                         // there are none unless the last call was left by an exception
  impl_->EvictUntil(impl_->options.window_size);  // it may have shrunk
  const bool is_admitted = impl_->Admit(std::move(frame));
  impl_->EstimatePending(impl_->options.min_source_views);
  if (is_admitted) impl_->ReestimateBest(impl_->window.back().get());
  impl_->ScheduleOlderThan(static_cast<size_t>(impl_->options.lookahead));
  if (is_admitted) impl_->RefineAgainHalfway();
  for (const WindowKeyframePtr& keyframe : std::exchange(impl_->leaving, {})) impl_->RefineAgain(keyframe);
}

void DenseMapper::Flush(bool refine_again) {
  impl_->EstimatePending(1);
  for (const WindowKeyframePtr& keyframe : impl_->window) {
    if (keyframe->state != WindowKeyframe::State::kPending) continue;
    impl_->Drop(keyframe, "no_source_views", impl_->DescribeMissing(keyframe.get(), 1));
  }
  impl_->ScheduleOlderThan(0);
  if (refine_again) impl_->RefineWindowAgain();
  impl_->outputs.WaitForAll();
}

void DenseMapper::Reset() {
  impl_->outputs.WaitForAll();
  // Emptied first: the mapper is in order even if a callback throws.
  std::deque<WindowKeyframePtr> unfinished;
  for (const ScheduledRefinement& refinement : impl_->waiting) unfinished.push_back(refinement.keyframe);
  for (const WindowKeyframePtr& keyframe : impl_->window) {
    if (keyframe->state != WindowKeyframe::State::kScheduled) unfinished.push_back(keyframe);
  }
  impl_->waiting.clear();
  impl_->window.clear();
  impl_->leaving.clear();
  impl_->peer_keyframes.clear();
  impl_->last_range.reset();
  impl_->last_id.reset();
  for (const WindowKeyframePtr& keyframe : unfinished) {
    impl_->Drop(keyframe, "reset", Concat("keyframe ", keyframe->frame->id, ": forgotten by a reset"));
  }
  impl_->outputs.WaitForAll();
}

void DenseMapper::SetPeerEstimate(ShardEstimate estimate) {
  const int shard = impl_->ShardOf(estimate.id);
  if (shard == impl_->shard.index) {
    throw InvalidInputError(Concat("estimate of keyframe ", estimate.id, ": that keyframe belongs to this shard, ",
                                   shard, " of ", impl_->shard.count));
  }
  impl_->lost_shards.erase(shard);
  if (!impl_->last_id || estimate.id > *impl_->last_id) return impl_->KeepForLater(std::move(estimate));
  const auto found = impl_->peer_keyframes.find(estimate.id);
  const WindowKeyframePtr keyframe = found == impl_->peer_keyframes.end() ? nullptr : found->second.lock();
  if (!keyframe) return;
  impl_->SettlePeer(keyframe.get(), std::move(estimate));
  impl_->RunReady();
}

void DenseMapper::StopWaiting() {
  if (impl_->waiting.empty()) return;
  for (const ScheduledRefinement::Source& source : impl_->waiting.front().sources) {
    if (source.Missing()) impl_->lost_shards.insert(source.keyframe->shard);
  }
  impl_->RunReady();
}

void DenseMapper::WaitForOutputs() { impl_->outputs.WaitForAll(); }

size_t DenseMapper::waiting() const { return impl_->waiting.size(); }

std::optional<int64_t> DenseMapper::oldest_waiting() const {
  if (impl_->waiting.empty()) return std::nullopt;
  return impl_->waiting.front().keyframe->frame->id;
}

size_t DenseMapper::unfinished() const {
  const auto pending = std::count_if(impl_->window.begin(), impl_->window.end(), [this](const auto& keyframe) {
    return impl_->IsOwn(*keyframe) && keyframe->state != WindowKeyframe::State::kScheduled;
  });
  return static_cast<size_t>(pending) + impl_->waiting.size();
}

}  // namespace acmp
