#include "acmp_mapping/mapping/dense_mapper.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "failure.h"
#include "keyframe_estimator.h"
#include "keyframe_window.h"
#include "mapper_outputs.h"
#include "pose_shift.h"
#include "refinement_policy.h"
#include "side_by_side.h"
#include "window_poses.h"

namespace acmp {
namespace {

static_assert(kMaxSelectedViews == kMaxSourceViews, "no more views are chosen than the matcher takes");

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
  if (!frame.mask.empty() && !fits(frame.mask.width(), frame.mask.height())) {
    throw InvalidInputError(Concat(name, ": mask size ", frame.mask.width(), " x ", frame.mask.height(),
                                   ": must be the camera's, ", frame.camera.width, " x ", frame.camera.height));
  }
  if (IgnoresAll(frame.mask)) throw InvalidInputError(name + ": its mask ignores every pixel");
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
  Validate(options.poses);
  const DepthRange& fallback = options.fallback_depth_range;
  if (HasDepthRange(fallback)) CheckDepthRange("depth_min and depth_max", fallback);
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
        poses(options.poses),
        outputs(output_engine != nullptr ? output_engine : engine, output_engine != nullptr, std::move(callbacks)) {}

  void Drop(const WindowKeyframePtr& keyframe, const Failure& failure) {
    keyframe->state = State::kFinished;
    outputs.SubmitDrop(keyframe->frame, failure, keyframe);
  }

  std::string DescribeLandmarks(size_t count) const {
    if (count == 0) return "no sparse points tell its depth range";
    return Concat("of its ", count, " sparse points fewer than ", options.depth_range.min_landmarks,
                  " are usable and in view");
  }

  std::optional<DepthRange> FindDepthRange(const Frame& frame) {
    if (const auto range = DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world,
                                                   options.depth_range)) {
      last_range = range;
    } else if (!last_range && HasDepthRange(options.fallback_depth_range)) {
      return options.fallback_depth_range;
    }
    return last_range;
  }

  /// Where refinement fails poses stay as they are, and that is told.
  template <class Work>
  void RefinePoses(int64_t id, const Work& work) {
    const auto failure = CatchFailure(work);
    if (!failure) return;
    outputs.SubmitProblem("pose_refinement_failed",
                          Concat("poses could not be refined with keyframe ", id, ": ", failure->message));
  }

  /// Whether the frame is in the window now.
  bool Admit(FramePtr frame, bool is_mapped) {
    const int64_t id = frame->id;
    if (const auto failure = CatchFailure([&] { CheckFrame(*frame); })) {
      // Not kept: as a source view it would make the others fail as well.
      if (!is_mapped) throw InvalidInputError(failure->message);
      outputs.SubmitDrop(frame, *failure, nullptr);
      return false;
    }
    ShrinkWindow(options.window_size - 1);
    const WindowKeyframePtr keyframe = window.Add(std::move(frame));
    keyframe->is_mapped = is_mapped;
    const std::optional<DepthRange> range = FindDepthRange(*keyframe->frame);
    if (range) keyframe->range = *range;
    RefinePoses(id, [&] { range ? poses.Add(keyframe, window) : poses.Finish(window); });
    HeedContradiction();
    if (!is_mapped) {
      keyframe->state = State::kFinished;
    } else if (!range) {
      Drop(keyframe, {"no_depth_range",
                      Concat("keyframe ", id, ": ", DescribeLandmarks(keyframe->frame->landmarks_in_world.size()),
                             ", and no earlier keyframe had a depth range: set depth_min and depth_max")});
    }
    return true;
  }

  /// What leaves is finished first, with the views there are.
  void ShrinkWindow(int size) {
    while (window.size() > static_cast<size_t>(size)) {
      const WindowKeyframePtr oldest = window.oldest();
      if (oldest->state == State::kInitialised) contradicted ? DropForContradiction(oldest) : Refine(oldest);
      if (oldest->state == State::kPending) DropForMissingViews(oldest, options.min_source_views);
      window.PopOldest();
    }
  }

  void DropForMissingViews(const WindowKeyframePtr& keyframe, int min_source_views) {
    Drop(keyframe, {"no_source_views", window.DescribeMissingViews(*keyframe, min_source_views)});
  }

  void DropForContradiction(const WindowKeyframePtr& keyframe) {
    Drop(keyframe, {"poses_contradict", Concat("keyframe ", keyframe->frame->id, ": ", DescribeContradiction())});
  }

  std::string DescribeContradiction() const {
    return Concat(
        "poses contradict the images: motions of the last keyframes put their maps ",
        100 * poses.checks().contradiction.value_or(0), " % of the depth apart, at most ",
        100 * options.pipeline.fusion.max_relative_depth,
        " % can be fused; the frontend has lost track, its scale changes, or calibration or stamps are wrong");
  }

  /// Where received poses contradict the images, maps would come to lie anywhere: those of the newest keyframes are
  /// withdrawn. They come back when poses agree again, clearly: by chance those of a lost frontend fit a little better
  /// now and then.
  void HeedContradiction() {
    const double limit = (contradicted ? 0.5 : 1.0) * options.pipeline.fusion.max_relative_depth;
    const bool was_contradicted = std::exchange(contradicted, poses.checks().contradiction.value_or(0) > limit);
    if (!contradicted) return BringBack();
    if (was_contradicted) return;
    for (size_t later = std::min(kContradictionImages, window.size()); later-- > 0;) {
      const WindowKeyframePtr& keyframe = window.WithLater(later);
      if (keyframe->is_withdrawn || !keyframe->refined_score) continue;
      keyframe->is_withdrawn = true;
      outputs.SubmitWithdrawal(keyframe, DescribeContradiction());
    }
  }

  /// Maps of keyframes that have been withdrawn. Where that fails they stay so, and it is tried again with the next
  /// keyframe.
  void BringBack() {
    for (const WindowKeyframePtr& keyframe : window) {
      if (!keyframe->is_withdrawn) continue;
      const SourceViews sources = window.SelectSources(*keyframe);
      keyframe->is_withdrawn = !sources.keyframes.empty() && !RefineAgain(keyframe, sources, true);
    }
  }

  void InitialisePending(int min_source_views) {
    for (const WindowKeyframePtr& keyframe : window) {
      if (keyframe->state != State::kPending) continue;
      const SourceViews sources = window.SelectSources(*keyframe);
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

  /// Makes the initial estimate of the keyframe anew if passes read it and poses have moved since.
  void BringUpToDate(const WindowKeyframePtr& keyframe) {
    if (!keyframe->initial || keyframe->EstimateForPasses() != keyframe->initial) return;
    if (!HaveMoved(*keyframe, keyframe->initial_views)) return;
    const SourceViews sources = window.SelectSources(*keyframe);
    if (!sources.keyframes.empty()) estimator.Initialise(keyframe.get(), sources);
  }

  /// The same of source views. Where it fails for one, that is told, and its old estimate is read: it is not the fault
  /// of the keyframe that reads it.
  void BringUpToDate(const SourceViews& sources) {
    for (const WindowKeyframePtr& source : sources.keyframes) {
      TryAgain(*source, [&] { BringUpToDate(source); });
    }
  }

  /// All steps of a refinement of one keyframe. What it throws leaves the keyframe as it was.
  FinishedEstimate TakeAllSteps(const WindowKeyframePtr& keyframe, const SourceViews& sources,
                                const EngineEstimatePtr& start) {
    KeyframeRefinement refinement =
        estimator.Begin(keyframe, sources, start, RefinementPolicy::LacksFutureViews(window, *keyframe));
    for (size_t step = 1; step < estimator.num_steps(); ++step) estimator.Step(step, &refinement);
    return estimator.Finish(std::move(refinement));
  }

  void Refine(const WindowKeyframePtr& keyframe) {
    const SourceViews sources = window.SelectSources(*keyframe);
    // Its first views may have left the window meanwhile.
    if (sources.keyframes.empty()) return DropForMissingViews(keyframe, 1);
    FinishedEstimate estimate;
    const auto failure = CatchFailure([&] {
      BringUpToDate(keyframe);
      BringUpToDate(sources);
      estimate = TakeAllSteps(keyframe, sources, keyframe->initial);
    });
    if (failure) return Drop(keyframe, *failure);
    keyframe->state = State::kFinished;
    outputs.SubmitRefined(keyframe, std::move(estimate), options.pipeline.fusion, false);
  }

  bool WantsRefinedAgain(const WindowKeyframe& keyframe) {
    return options.refine_again && !contradicted && !keyframe.is_withdrawn && keyframe.refined_score;
  }

  /// Does something for a finished keyframe that is refined again. Where it fails that is told, the maps that others
  /// have of it stay as they are, and nobody else is concerned.
  template <class Work>
  bool TryAgain(const WindowKeyframe& keyframe, const Work& work) {
    const auto failure = CatchFailure(work);
    if (failure) {
      outputs.SubmitProblem("refine_again_failed", DescribeFailedAgain(keyframe.frame->id, *failure));
    }
    return !failure;
  }

  /// A new initial estimate if the keyframe's is worse than it could be.
  void InitialiseAgain(const WindowKeyframePtr& keyframe, const SourceViews& sources) {
    if (RefinementPolicy::NeedsNewInitial(*keyframe, sources)) estimator.Initialise(keyframe.get(), sources);
  }

  void SubmitAgain(const WindowKeyframePtr& keyframe, FinishedEstimate estimate, bool has_read_better_maps) {
    keyframe->refined_again_at = keyframe->refined_at;
    keyframe->has_read_better_maps = has_read_better_maps;
    outputs.SubmitRefined(keyframe, std::move(estimate), options.pipeline.fusion, true);
  }

  bool RefineAgain(const WindowKeyframePtr& keyframe, const SourceViews& sources, bool from_initial) {
    return TryAgain(*keyframe, [&] {
      if (from_initial) InitialiseAgain(keyframe, sources);
      BringUpToDate(sources);
      SubmitAgain(keyframe, TakeAllSteps(keyframe, sources, from_initial ? keyframe->initial : keyframe->refined),
                  !from_initial);
    });
  }

  /// The keyframe that has as many later ones as earlier ones to be matched against, at most.
  void RefineHalfwayAgain() {
    const size_t half = static_cast<size_t>(options.window_size) / 2;
    if (window.size() <= half) return;
    const WindowKeyframePtr& keyframe = window.WithLater(half);
    if (!WantsRefinedAgain(*keyframe)) return;
    const SourceViews sources = window.SelectSources(*keyframe);
    const RefinementPolicy::Again again = RefinementPolicy::Decide(*keyframe, sources);
    if (again == RefinementPolicy::Again::kNo) return;
    RefineAgain(keyframe, sources, again == RefinementPolicy::Again::kFromInitial);
  }

  std::vector<KeyframeRefinement> BeginSideBySide() {
    std::vector<WindowKeyframePtr> wanted;
    std::copy_if(window.begin(), window.end(), std::back_inserter(wanted),
                 [&](const WindowKeyframePtr& keyframe) { return WantsRefinedAgain(*keyframe); });
    std::vector<KeyframeRefinement> members;
    for (const auto& [keyframe, sources] : RefinementPolicy::ChooseForSideBySide(window, wanted)) {
      TryAgain(*keyframe, [&, &keyframe = keyframe, &sources = sources] {
        InitialiseAgain(keyframe, sources);
        members.push_back(estimator.Begin(keyframe, sources, keyframe->initial,
                                          RefinementPolicy::LacksFutureViews(window, *keyframe)));
      });
    }
    return members;
  }

  /// All that is to come has come. Keyframes take their steps side by side, as offline: each reads what the step before
  /// has made of the others.
  void RefineWindowAgain(const std::atomic<bool>* stop) {
    if (stop != nullptr && *stop) return;
    std::vector<KeyframeRefinement> members = BeginSideBySide();
    const SideBySide side_by_side(members);
    const auto for_each_member = [&](const auto& work) {
      std::vector<KeyframeRefinement> going_on;
      for (KeyframeRefinement& member : members) {
        if (stop != nullptr && *stop) break;
        if (TryAgain(*member.keyframe, [&] { work(&member); })) going_on.push_back(std::move(member));
      }
      members = std::move(going_on);
    };
    for (size_t step = 1; step < estimator.num_steps(); ++step) {
      for_each_member([&](KeyframeRefinement* member) { estimator.Step(step, member); });
      SideBySide::Share(members);
    }
    for_each_member([&](KeyframeRefinement* member) {
      const WindowKeyframePtr keyframe = member->keyframe;
      SubmitAgain(keyframe, estimator.Finish(*member), false);
    });
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
    if (!contradicted) RefineWithLater(static_cast<size_t>(options.lookahead));
    if (is_admitted) RefineHalfwayAgain();
  }

  DenseMapperOptions options;
  KeyframeWindow window;
  KeyframeEstimator estimator;
  WindowPoses poses;
  std::optional<DepthRange> last_range;
  std::optional<int64_t> last_id;
  bool contradicted = false;  ///< received poses, by the images
  MapperOutputs outputs;      ///< last: its thread is gone before what is above
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

void DenseMapper::Flush(const std::atomic<bool>* stop) {
  if (impl_->last_id) impl_->RefinePoses(*impl_->last_id, [&] { impl_->poses.Finish(impl_->window); });
  impl_->HeedContradiction();
  impl_->InitialisePending(1);
  for (const WindowKeyframePtr& keyframe : impl_->window) {
    if (keyframe->state == WindowKeyframe::State::kPending) impl_->DropForMissingViews(keyframe, 1);
    if (impl_->contradicted && keyframe->state == WindowKeyframe::State::kInitialised)
      impl_->DropForContradiction(keyframe);
  }
  impl_->RefineWithLater(0);
  impl_->RefineWindowAgain(stop);
  impl_->outputs.WaitForAll();
}

void DenseMapper::Reset() {
  impl_->outputs.WaitForAll();
  // Emptied first: the mapper is in order even if a callback throws.
  const KeyframeWindow forgotten = std::exchange(impl_->window, KeyframeWindow(impl_->options.source_views));
  impl_->poses.Reset();
  impl_->last_range.reset();
  impl_->last_id.reset();
  impl_->contradicted = false;
  for (const WindowKeyframePtr& keyframe : forgotten) {
    if (keyframe->state == WindowKeyframe::State::kFinished) continue;
    impl_->Drop(keyframe, {"reset", Concat("keyframe ", keyframe->frame->id, ": forgotten by a reset")});
  }
  impl_->outputs.WaitForAll();
}

void DenseMapper::WaitForOutputs() { impl_->outputs.WaitForAll(); }

PoseChecks DenseMapper::pose_checks() const { return impl_->poses.checks(); }

size_t DenseMapper::unfinished() const {
  return static_cast<size_t>(std::count_if(impl_->window.begin(), impl_->window.end(), [](const auto& keyframe) {
    return keyframe->state != WindowKeyframe::State::kFinished;
  }));
}

}  // namespace acmp
