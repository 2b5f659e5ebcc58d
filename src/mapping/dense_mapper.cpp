#include "acmp_mapping/mapping/dense_mapper.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "failure.h"
#include "keyframe_estimator.h"
#include "keyframe_window.h"
#include "mapper_outputs.h"
#include "refinement_policy.h"

namespace acmp {
namespace {

static_assert(kMaxRankedViews == kMaxSourceViews, "the selector must not rank more views than the matcher takes");

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

}  // namespace

void Validate(const DenseMapperOptions& options) {
  Validate(options.pipeline);
  if (options.pipeline.multi_scale) {
    throw InvalidInputError(
        "preset acmm: needs the maps of all images at every scale, which only the offline schedule has");
  }
  Validate(options.source_views);
  Validate(options.depth_range);
  const DepthRange& fallback = options.fallback_depth_range;
  if (!(fallback.min == 0 && fallback.max == 0)) CheckDepthRange("fallback_depth_range", fallback);
  CheckRange("window_size", options.window_size, 2, kMaxWindowSize);
  CheckRange("lookahead", options.lookahead, 0, options.window_size - 1);
  CheckRange("min_source_views", options.min_source_views, 1,
             std::min(options.source_views.max_source_views, options.window_size - 1));
}

/// The online schedule: which keyframe is initialised, refined and refined again when.
struct DenseMapper::Impl {
  using State = WindowKeyframe::State;

  Impl(DepthEngine* engine, const DenseMapperOptions& mapper_options, Callbacks callbacks, DepthEngine* output_engine)
      : options(mapper_options),
        window(options.source_views),
        estimator(engine, options.pipeline),
        outputs(output_engine != nullptr ? output_engine : engine, output_engine != nullptr, std::move(callbacks)) {}

  void Drop(const WindowKeyframePtr& keyframe, const Failure& failure) {
    keyframe->state = State::kFinished;
    outputs.SubmitDrop({keyframe->frame->id, failure.reason, failure.message}, keyframe);
  }

  std::optional<DepthRange> FindDepthRange(const Frame& frame) {
    if (const auto range = DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world,
                                                   options.depth_range)) {
      last_range = range;
    } else if (!last_range && options.fallback_depth_range.max > 0) {
      return options.fallback_depth_range;
    }
    return last_range;
  }

  /// Whether the frame is in the window now.
  bool Admit(FramePtr frame, bool is_mapped) {
    const int64_t id = frame->id;
    if (const auto failure = CatchFailure([&] { CheckFrame(*frame); })) {
      // Not kept: as a source view it would make the others fail as well.
      if (!is_mapped) throw InvalidInputError(failure->message);
      outputs.SubmitDrop({id, failure->reason, failure->message}, nullptr);
      return false;
    }
    ShrinkWindow(options.window_size - 1);
    const WindowKeyframePtr keyframe = window.Add(std::move(frame));
    keyframe->is_mapped = is_mapped;
    if (!is_mapped) {
      keyframe->state = State::kFinished;
    } else if (const std::optional<DepthRange> range = FindDepthRange(*keyframe->frame)) {
      keyframe->range = *range;
    } else {
      Drop(keyframe, {"no_depth_range",
                      Concat("keyframe ", id, ": of its ", keyframe->frame->landmarks_in_world.size(),
                             " landmarks fewer than ", options.depth_range.min_landmarks,
                             " are usable and in view, no earlier keyframe had a depth range, and no fallback range is "
                             "set")});
    }
    return true;
  }

  /// What leaves is finished first, with the views there are.
  void ShrinkWindow(int size) {
    while (window.size() > static_cast<size_t>(size)) {
      const WindowKeyframePtr oldest = window.oldest();
      if (oldest->state == State::kInitialised) Refine(oldest);
      if (oldest->state == State::kPending) DropForMissingViews(oldest, options.min_source_views);
      window.PopOldest();
    }
  }

  void DropForMissingViews(const WindowKeyframePtr& keyframe, int min_source_views) {
    Drop(keyframe, {"no_source_views", window.DescribeMissingViews(keyframe.get(), min_source_views)});
  }

  void InitialisePending(int min_source_views) {
    for (const WindowKeyframePtr& keyframe : window) {
      if (keyframe->state != State::kPending) continue;
      const SourceViews sources = window.SelectSources(keyframe.get());
      if (sources.keyframes.size() < static_cast<size_t>(min_source_views)) continue;
      FinishedEstimate estimate;
      if (const auto failure = CatchFailure([&] { estimate = estimator.Initialise(keyframe.get(), sources); })) {
        Drop(keyframe, *failure);
        continue;
      }
      keyframe->state = State::kInitialised;
      outputs.SubmitFast(keyframe, std::move(estimate));
    }
  }

  void RefineWithLater(size_t later_keyframes) {
    for (size_t later = window.size(); later-- > later_keyframes;) {
      const WindowKeyframePtr& keyframe = window.WithLater(later);
      if (keyframe->state == State::kInitialised) Refine(keyframe);
    }
  }

  void Refine(const WindowKeyframePtr& keyframe) {
    const SourceViews sources = window.SelectSources(keyframe.get());
    // Its first views may have left the window meanwhile.
    if (sources.keyframes.empty()) return DropForMissingViews(keyframe, 1);
    FinishedEstimate estimate;
    const auto failure = CatchFailure([&] {
      estimate = estimator.Refine(keyframe.get(), sources, keyframe->initial,
                                  RefinementPolicy::LacksFutureViews(window, *keyframe));
    });
    if (failure) return Drop(keyframe, *failure);
    keyframe->state = State::kFinished;
    outputs.SubmitRefined(keyframe, std::move(estimate), options.pipeline.fusion);
  }

  bool WantsRefinedAgain(const WindowKeyframe& keyframe) {
    return options.refine_again && keyframe.refined_score && outputs.WantsRefinedAgain(keyframe);
  }

  /// A new initial estimate if the keyframe's is worse than it could be. Where that fails it stays as it is.
  bool InitialiseAgain(const WindowKeyframePtr& keyframe, const SourceViews& sources) {
    if (!RefinementPolicy::NeedsNewInitial(*keyframe, sources)) return true;
    const auto failure = CatchFailure([&] { estimator.Initialise(keyframe.get(), sources); });
    if (failure) outputs.ReportFailedAgain(keyframe->frame->id, *failure);
    return !failure;
  }

  /// Makes the maps of a finished keyframe anew, from its initial estimate or its refined one. Where that fails its
  /// maps stay as they are.
  bool RefineAgainFrom(RefinementPolicy::Again again, const WindowKeyframePtr& keyframe, const SourceViews& sources) {
    const bool from_initial = again == RefinementPolicy::Again::kFromInitial;
    if (from_initial && !InitialiseAgain(keyframe, sources)) return false;
    FinishedEstimate estimate;
    const auto failure = CatchFailure([&] {
      estimate = estimator.Refine(keyframe.get(), sources, from_initial ? keyframe->initial : keyframe->refined,
                                  RefinementPolicy::LacksFutureViews(window, *keyframe));
    });
    if (failure) {
      outputs.ReportFailedAgain(keyframe->frame->id, *failure);
      return false;
    }
    keyframe->refined_again_at = keyframe->refined_at;
    keyframe->has_read_better_maps = !from_initial;
    outputs.SubmitRefinedAgain(std::move(estimate), options.pipeline.fusion);
    return true;
  }

  /// If the policy says so. Returns whether it was.
  bool RefineAgain(const WindowKeyframePtr& keyframe) {
    if (!WantsRefinedAgain(*keyframe)) return false;
    const SourceViews sources = window.SelectSources(keyframe.get());
    const RefinementPolicy::Again again = RefinementPolicy::Decide(*keyframe, sources);
    return again != RefinementPolicy::Again::kNo && RefineAgainFrom(again, keyframe, sources);
  }

  /// The keyframe that has as many later ones as earlier ones to be matched against, at most.
  void RefineHalfwayAgain() {
    const size_t half = static_cast<size_t>(options.window_size) / 2;
    if (window.size() > half) RefineAgain(window.WithLater(half));
  }

  /// All that is to come has come. Keyframes whose views have become better get new initial estimates first, which the
  /// refinements of all then read in place of what was made with worse views. Then each is refined once more: it reads
  /// finished maps.
  void RefineWindowAgain() {
    for (const WindowKeyframePtr& keyframe : window) {
      if (!WantsRefinedAgain(*keyframe)) continue;
      const SourceViews sources = window.SelectSources(keyframe.get());
      if (RefinementPolicy::Decide(*keyframe, sources) != RefinementPolicy::Again::kFromInitial) continue;
      if (InitialiseAgain(keyframe, sources)) keyframe->refined.reset();
    }
    std::vector<WindowKeyframePtr> refined;
    for (const WindowKeyframePtr& keyframe : window) {
      if (RefineAgain(keyframe)) refined.push_back(keyframe);
    }
    for (const WindowKeyframePtr& keyframe : refined) {
      if (!WantsRefinedAgain(*keyframe)) return;
      RefineAgainFrom(RefinementPolicy::Again::kFromRefined, keyframe, window.SelectSources(keyframe.get()));
    }
  }

  void Add(FramePtr frame, bool is_mapped) {
    if (!frame) throw InvalidInputError("frame: must not be null");
    if (last_id && frame->id <= *last_id) {
      throw InvalidInputError(
          Concat("frame id = ", frame->id, ": must be above ", *last_id, ", the previous keyframe's"));
    }
    last_id = frame->id;
    ShrinkWindow(options.window_size);  // options may have made it smaller
    const bool is_admitted = Admit(std::move(frame), is_mapped);
    InitialisePending(options.min_source_views);
    RefineWithLater(static_cast<size_t>(options.lookahead));
    if (is_admitted) RefineHalfwayAgain();
  }

  DenseMapperOptions options;
  KeyframeWindow window;
  KeyframeEstimator estimator;
  std::optional<DepthRange> last_range;
  std::optional<int64_t> last_id;
  MapperOutputs outputs;  ///< last: its thread is gone before what is above
};

DenseMapper::DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks,
                         DepthEngine* output_engine) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  if (output_engine == engine) throw InvalidInputError("output_engine: must not be the engine of the passes");
  Validate(options);
  impl_ = std::make_unique<Impl>(engine, options, std::move(callbacks), output_engine);
}

DenseMapper::~DenseMapper() = default;

void DenseMapper::set_options(const DenseMapperOptions& options) {
  Validate(options);
  impl_->options = options;
  impl_->estimator.set_options(options.pipeline);
  impl_->window.set_options(options.source_views);
}

void DenseMapper::AddKeyframe(FramePtr frame) { impl_->Add(std::move(frame), true); }

void DenseMapper::AddSourceImage(FramePtr frame) { impl_->Add(std::move(frame), false); }

void DenseMapper::Flush(bool refine_again) {
  impl_->InitialisePending(1);
  for (const WindowKeyframePtr& keyframe : impl_->window) {
    if (keyframe->state == WindowKeyframe::State::kPending) impl_->DropForMissingViews(keyframe, 1);
  }
  impl_->RefineWithLater(0);
  if (refine_again) impl_->RefineWindowAgain();
  impl_->outputs.WaitForAll();
}

void DenseMapper::Reset() {
  impl_->outputs.WaitForAll();
  // Emptied first: the mapper is in order even if a callback throws.
  const KeyframeWindow forgotten = std::exchange(impl_->window, KeyframeWindow(impl_->options.source_views));
  impl_->last_range.reset();
  impl_->last_id.reset();
  for (const WindowKeyframePtr& keyframe : forgotten) {
    if (keyframe->state == WindowKeyframe::State::kFinished) continue;
    impl_->Drop(keyframe, {"reset", Concat("keyframe ", keyframe->frame->id, ": forgotten by a reset")});
  }
  impl_->outputs.WaitForAll();
}

void DenseMapper::WaitForOutputs() { impl_->outputs.WaitForAll(); }

size_t DenseMapper::unfinished() const {
  return static_cast<size_t>(std::count_if(impl_->window.begin(), impl_->window.end(), [](const auto& keyframe) {
    return keyframe->state != WindowKeyframe::State::kFinished;
  }));
}

}  // namespace acmp
