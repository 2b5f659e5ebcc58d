#include "acmp_mapping/mapping/dense_mapper.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/common/stop_request.h"
#include "keyframe_estimator.h"
#include "keyframe_window.h"
#include "mapper_outputs.h"
#include "window_poses.h"

namespace acmp {
namespace {

static_assert(kMaxSelectedViews == kMaxSourceViews, "no more views are chosen than the matcher takes");

/// MakeFrame guarantees this; frames from elsewhere must not reach the kernels with sizes that do not fit.
void CheckFrame(const Frame& frame) {
  const std::string name = Concat("keyframe ", frame.id);
  CheckCamera(name, frame.camera);
  CheckPose(name.c_str(), frame.cam_from_world);
  const auto check_size = [&](const char* what, const auto& map) {
    CheckSize(name + ": " + what, map.width(), map.height(), frame.camera);
  };
  check_size("image", frame.gray);
  if (!frame.color.empty()) check_size("colour image", frame.color);
  if (!frame.mask.empty()) check_size("mask", frame.mask);
  if (!frame.labels.empty()) check_size("labels", frame.labels);
  if (IgnoresAll(frame.mask)) throw InvalidInputError(name + ": its mask ignores every pixel");
}

/// The online schedule: after how many later keyframes one takes which steps of ScheduleOf. Who takes steps at the same
/// time reads what the others have after the step before (Jacobi), as offline; all else is read as the window has it.
///
/// | turn    | steps      | which keyframes                                                              |
/// |---------|------------|------------------------------------------------------------------------------|
/// | initial | the first  | each, once it has enough source views                                        |
/// | refined | all others | those with an initial estimate                                               |
/// | again   | all others | refined ones whose views have not become worse, if any of them would gain    |
/// | back    | all others | those whose maps were withdrawn, once received poses agree with the images   |
struct Turns {
  int min_source_views;                 ///< of `initial`
  size_t refined_fewest, refined_most;  ///< later keyframes
  size_t again_fewest, again_most;      ///< the same; of `back` any
  bool may_wait = false;                ///< `again` and `back` are left to CatchUp
};

/// As soon as a keyframe comes: `again` is for the one that has as many later ones as earlier ones to be matched
/// against. Live, what is held back meanwhile is not refined with the keyframe that ends that.
Turns TurnsOfStream(const DenseMapperOptions& options) {
  const size_t half = static_cast<size_t>(options.window_size) / 2;
  const size_t lookahead = static_cast<size_t>(options.lookahead);
  return {options.min_source_views, lookahead, options.live ? lookahead : kMaxWindowSize, half, half, options.live};
}

/// Nothing more comes.
constexpr Turns kTurnsOfFlush = {1, 0, kMaxWindowSize, 0, kMaxWindowSize};

/// With fewer later keyframes the passes of other keyframes read a keyframe's initial estimate, not its refined one. No
/// later view has confirmed the newest part of a refined map: its errors there are those of the maps that it was made
/// of, and would go on from keyframe to keyframe. Errors of initial estimates are independent. Measured: with two later
/// keyframes initial estimates serve others better, with five refined ones do.
constexpr size_t kEnoughLaterKeyframes = 3;

/// Live, of a keyframe's source views: others wait until there is time, since that takes as long as a keyframe.
constexpr int kMostMadeAnew = 1;

constexpr size_t kRangeFrames = 8;  ///< images whose matches give a depth range where no landmarks do

}  // namespace

void Validate(const DenseMapperOptions& options) {
  Validate(options.pipeline);
  if (options.pipeline.multi_scale) {
    throw InvalidInputError(
        "preset acmm: needs the maps of all images at every scale, which only the offline schedule has");
  }
  CheckRange("max_source_views", options.max_source_views, 1, kMaxSelectedViews);
  CheckRange("max_contradiction", options.max_contradiction, 1e-6, 1.0);
  Validate(options.poses);
  const DepthRange& fallback = options.fallback_depth_range;
  if (HasDepthRange(fallback)) CheckDepthRange("depth_min and depth_max", fallback);
  CheckRange("window_size", options.window_size, 2, kMaxWindowSize);
  CheckRange("lookahead", options.lookahead, 0, options.window_size - 1);
  CheckRange("min_source_views", options.min_source_views, 1,
             std::min(options.max_source_views, options.window_size - 1));
}

OptionList OptionsOf(DenseMapperOptions* o) {
  OptionList list;
  list.Group("window of keyframes");
  list.Number("window_size", &o->window_size, 2, kMaxWindowSize, "",
              "Keyframes kept to match against; each takes 55 bytes of GPU memory per pixel");
  list.Number("lookahead", &o->lookahead, 0, kMaxWindowSize - 1, "",
              "Later keyframes that a refined map waits for, below window_size; 0: lowest latency")
      .WhileRunning();
  list.Number("max_source_views", &o->max_source_views, 1, kMaxSourceViews, "",
              "Keyframes that each keyframe is matched against; time grows with it")
      .WhileRunning();
  list.Flag("refine_again", &o->refine_again,
            "Refine a keyframe once more halfway through the window, and at a flush, where its views have become "
            "better");
  const Option refine_poses = OptionsOf(&o->poses).Find("refine_poses");
  list.Add(refine_poses.name, refine_poses.sentence, refine_poses.get, refine_poses.set).choices = refine_poses.choices;
  list.Number(
          "depth_min", &o->fallback_depth_range.min, 0, 1e9, "(unit of the poses)",
          "Nearest depth to search where no sparse points tell, with depth_max; 0: found by matches between keyframes")
      .WhileRunning();
  list.Number("depth_max", &o->fallback_depth_range.max, 0, 1e9, "(unit of the poses)",
              "Farthest depth to search there")
      .WhileRunning();
  return list;
}

/// The keyframes of the window take their turns.
struct DenseMapper::Impl {
  using State = WindowKeyframe::State;

  Impl(DepthEngine* engine, const DenseMapperOptions& mapper_options, Callbacks callbacks, DepthEngine* output_engine,
       StopRequest* stop_request)
      : stop(stop_request != nullptr ? stop_request : &never),
        options(mapper_options),
        window(options.max_source_views),
        estimator(engine, options.pipeline),
        poses(options.poses.refine == RefinePoses::kOff ? nullptr
                                                        : std::make_unique<PoseRefiner>(options.poses, options.live),
              options.live),
        outputs(output_engine != nullptr ? output_engine : engine, output_engine != nullptr, std::move(callbacks),
                stop) {}

  void Add(const Capture& capture) {
    std::optional<int64_t> id = last_id;
    for (const std::vector<FramePtr>* frames : {&capture.keyframes, &capture.companions}) {
      for (const FramePtr& frame : *frames) {
        if (!frame) throw InvalidInputError("frame: must not be null");
        if (id && frame->id <= *id) {
          throw InvalidInputError(
              Concat("frame id = ", frame->id, ": must be above ", *id, ", the previous keyframe's"));
        }
        id = frame->id;
      }
    }
    if (capture.keyframes.empty() && capture.companions.empty()) throw InvalidInputError("capture: has no image");
    last_id = id;
    tried.clear();
    made_anew.clear();
    WindowCapture added(capture);
    LeaveOutRefused(&added);
    is_admitted = false;
    stop->RunCancellable([&] {
      ShrinkWindow(options.window_size);  // options may have made it smaller
      if (!added.images.empty()) Admit(added);
      TakeTurns(TurnsOfStream(options));
    });
    if (!stop->requested() || is_admitted) return;
    for (const WindowKeyframePtr& image : added.images) {
      if (image->is_mapped) outputs.SubmitDrop(image->frame, ForgottenByReset(*image->frame), nullptr);
    }
  }

  void Flush() {
    stop->RunCancellable([&] {
      if (last_id) RefinePoses(*last_id, [&] { poses.Finish(window); });
      TakeTurns(kTurnsOfFlush);
      for (const WindowKeyframePtr& keyframe : window.Images()) EndIfUnfinished(keyframe, 1);
    });
    outputs.WaitForAll();
  }

  bool CatchUp() {
    bool is_done = false;
    if (!last_id) return is_done;
    stop->RunCancellable([&] {
      RefinePoses(*last_id, [&] { poses.Update(window); });
      is_done = !contradicted && (RefineHeldBack() || RefineNextAgain());
    });
    return is_done;
  }

  // The schedule.

  /// While received poses contradict the images nothing is refined.
  void TakeTurns(const Turns& turns) {
    for (const WindowKeyframePtr& keyframe : window.Images()) {
      if (keyframe->state == State::kPending) Initialise(keyframe, turns.min_source_views);
    }
    if (contradicted) return;
    for (const WindowKeyframePtr& keyframe : window.Images()) {
      const size_t later = window.NumLaterThan(*keyframe);
      if (keyframe->state != State::kInitialised || later < turns.refined_fewest || later > turns.refined_most)
        continue;
      Refine(keyframe);
    }
    if (!turns.may_wait) TakeSteps(DueAgain(turns));
  }

  /// The newest one that was held back; false: there is none.
  bool RefineHeldBack() {
    for (const WindowKeyframePtr& keyframe : NewestFirst()) {
      if (keyframe->state != State::kInitialised) continue;
      if (window.NumLaterThan(*keyframe) < static_cast<size_t>(options.lookahead)) continue;
      if (!MakeNextAnew(window.SelectSources(*keyframe))) Refine(keyframe);
      return true;
    }
    return false;
  }

  /// The newest one that was withdrawn or is past its turn to be refined again and would gain; false: there is none.
  bool RefineNextAgain() {
    const auto half = static_cast<size_t>(options.window_size) / 2;
    for (const WindowKeyframePtr& keyframe : NewestFirst()) {
      if (!keyframe->refined_score || tried.count(keyframe->frame->id) > 0) continue;
      const bool has_turn = options.refine_again && !keyframe->had_turn && window.NumLaterThan(*keyframe) >= half;
      if (!has_turn && !keyframe->is_withdrawn) continue;
      SourceViews sources = window.SelectSources(*keyframe);
      const bool gains = !sources.keyframes.empty() && (keyframe->is_withdrawn || WouldGain(*keyframe, sources));
      if (gains && MakeNextAnew(sources)) return true;
      keyframe->had_turn = keyframe->had_turn || has_turn;
      tried.insert(keyframe->frame->id);
      if (!gains) continue;
      TakeSteps({{keyframe, std::move(sources)}});
      return true;
    }
    return false;
  }

  std::vector<WindowKeyframePtr> NewestFirst() const {
    std::vector<WindowKeyframePtr> images = window.Images();
    std::reverse(images.begin(), images.end());
    return images;
  }

  void Initialise(const WindowKeyframePtr& keyframe, int min_source_views) {
    KeyframeSteps steps = {keyframe, window.SelectSources(*keyframe)};
    const SourceViews& sources = steps.sources;
    if (sources.keyframes.size() < static_cast<size_t>(min_source_views) && sources.of_capture.empty()) return;
    if (!Try(keyframe, [&] { estimator.Initialise(&steps); })) return;
    keyframe->state = State::kInitialised;
    outputs.SubmitFast(std::move(steps));
  }

  void Refine(const WindowKeyframePtr& keyframe) {
    KeyframeSteps due = {keyframe, window.SelectSources(*keyframe)};
    // Its first views may have left the window meanwhile.
    if (due.sources.keyframes.empty()) return DropForMissingViews(keyframe, 1);
    TakeSteps({std::move(due)});
  }

  /// If any would gain, those whose views have not become worse as well, for they read each other.
  std::vector<KeyframeSteps> DueAgain(const Turns& turns) const {
    std::vector<KeyframeSteps> due;
    bool any_gains = false;
    for (const WindowKeyframePtr& keyframe : window.Images()) {
      const size_t later = window.NumLaterThan(*keyframe);
      const bool has_turn = options.refine_again && later >= turns.again_fewest && later <= turns.again_most;
      if (!keyframe->refined_score || !(has_turn || keyframe->is_withdrawn)) continue;
      SourceViews sources = window.SelectSources(*keyframe);
      const bool gains = keyframe->is_withdrawn || WouldGain(*keyframe, sources);
      any_gains = any_gains || gains;
      if (sources.keyframes.empty() || !(gains || sources.score >= *keyframe->refined_score)) continue;
      due.push_back({keyframe, std::move(sources)});
    }
    if (!any_gains) due.clear();
    return due;
  }

  /// All steps after the first, side by side.
  void TakeSteps(std::vector<KeyframeSteps> members) {
    const bool is_alone = members.size() == 1;
    const auto for_each = [&](const auto& work) {
      std::vector<KeyframeSteps> going_on;
      for (KeyframeSteps& member : members) {
        if (Try(member.keyframe, [&] { work(&member); })) going_on.push_back(std::move(member));
      }
      members = std::move(going_on);
      if (is_alone) return;  // an estimate that nobody else holds gives the next one its memory
      for (const KeyframeSteps& member : members) member.keyframe->shared = member.problem.reference.estimate;
    };
    for_each([&](KeyframeSteps* member) {
      if (NeedsNewInitial(*member->keyframe, member->sources)) estimator.Initialise(member);
      BringUpToDate(*member);
      estimator.Begin(member, window.NumLaterThan(*member->keyframe) < kEnoughLaterKeyframes);
    });
    for (size_t step = 1; step < estimator.num_steps(); ++step) {
      for_each([&](KeyframeSteps* member) { estimator.Step(step, member); });
    }
    for_each([&](KeyframeSteps* member) {
      estimator.Finish(member);
      const bool again = std::exchange(member->keyframe->state, State::kFinished) == State::kFinished;
      outputs.SubmitRefined(*member, options.pipeline.fusion, again);
    });
    for (const WindowKeyframePtr& keyframe : window.Images()) keyframe->shared.reset();
  }

  /// Makes initial estimates that are missing or whose poses have moved since: of companions, which say what moves, and
  /// of those that the keyframe's passes read: live, of the best views. Where it fails, that is told, and the old
  /// estimate or none is read: it is not the fault of the keyframe that reads it.
  void BringUpToDate(const KeyframeSteps& steps) {
    for (const WindowKeyframePtr& companion : steps.sources.of_capture) {
      if (companion->is_mapped || companion->initial) continue;
      MakeAnew(companion);
      steps.keyframe->times += std::exchange(companion->times, {});
    }
    int may_make_anew = options.live ? kMostMadeAnew : kMaxSelectedViews;
    for (const WindowKeyframePtr& source : steps.sources.keyframes) {
      if (may_make_anew == 0 || !IsOutdated(*source)) continue;
      MakeAnew(source);
      --may_make_anew;
      if (!source->is_mapped) steps.keyframe->times += std::exchange(source->times, {});
    }
  }

  /// Its initial estimate is read, and was made with other poses.
  static bool IsOutdated(const WindowKeyframe& source) {
    const bool is_read = source.initial && source.EstimateForPasses() == source.initial;
    return is_read && HaveMoved(source, source.initial_views);
  }

  void MakeAnew(const WindowKeyframePtr& source) {
    KeyframeSteps steps = {source, window.SelectSources(*source)};
    if (steps.sources.keyframes.empty()) return;
    const auto failure = CatchFailure([&] { estimator.Initialise(&steps); });
    stop->Check();
    if (failure) ReportFailedAgain(*source, *failure);
  }

  /// One of BringUpToDate's at a time; false: there is none.
  bool MakeNextAnew(const SourceViews& sources) {
    for (const WindowKeyframePtr& source : sources.keyframes) {
      if (!IsOutdated(*source) || !made_anew.insert(source->frame->id).second) continue;
      MakeAnew(source);
      return true;
    }
    return false;
  }

  /// Does something for a keyframe. Where it fails nobody else is concerned: a keyframe that has had its refined maps
  /// keeps them, and that is told; another one is dropped. Throws Interrupted, as what a stop has left may look like
  /// any error, or like none.
  template <class Work>
  bool Try(const WindowKeyframePtr& keyframe, const Work& work) {
    const auto failure = CatchFailure(work);
    stop->Check();
    if (!failure) return true;
    keyframe->state == State::kFinished ? ReportFailedAgain(*keyframe, *failure) : Drop(keyframe, *failure);
    return false;
  }

  void ReportFailedAgain(const WindowKeyframe& keyframe, const Failure& failure) {
    outputs.SubmitProblem("refine_again_failed", DescribeFailedAgain(keyframe.frame->id, failure));
  }

  void Drop(const WindowKeyframePtr& keyframe, const Failure& failure) {
    keyframe->state = State::kFinished;
    outputs.SubmitDrop(keyframe->frame, failure, keyframe);
  }

  void DropForMissingViews(const WindowKeyframePtr& keyframe, int min_source_views) {
    Drop(keyframe, {"no_source_views", window.DescribeMissingViews(*keyframe, min_source_views)});
  }

  // What comes and goes.

  /// What leaves is finished first, with the views there are.
  void ShrinkWindow(int size) {
    while (window.size() > static_cast<size_t>(size)) {
      for (const WindowKeyframePtr& keyframe : window.oldest().images) {
        EndIfUnfinished(keyframe, options.min_source_views);
        const bool lacks_turn = options.refine_again && !keyframe->had_turn;
        if (options.live && keyframe->refined_score && (lacks_turn || keyframe->is_withdrawn)) ++left_out.second_turns;
      }
      window.PopOldest();
    }
  }

  void EndIfUnfinished(const WindowKeyframePtr& keyframe, int min_source_views) {
    if (keyframe->state == State::kPending) DropForMissingViews(keyframe, min_source_views);
    if (keyframe->state != State::kInitialised) return;
    if (!contradicted) return Refine(keyframe);
    Drop(keyframe, {"poses_contradict", Concat("keyframe ", keyframe->frame->id, ": ", DescribeContradiction())});
  }

  /// @param added has images
  void Admit(const WindowCapture& added) {
    ShrinkWindow(options.window_size - 1);
    window.Add(added);
    const std::vector<WindowKeyframePtr>& images = added.images;
    is_admitted = true;
    for (const WindowKeyframePtr& image : images) {
      if (image->is_mapped || image == images.front()) FindDepthRange(image, images);
    }
    const auto has_range = [](const WindowKeyframePtr& image) { return HasDepthRange(image->range); };
    const auto with_range = std::find_if(images.begin(), images.end(), has_range);
    for (const WindowKeyframePtr& image : images) {
      if (!image->is_mapped && with_range != images.end()) image->range = (*with_range)->range;
    }
    RefinePoses(added.pose->id, [&] { with_range != images.end() ? poses.Add(added, window) : poses.Update(window); });
    for (const WindowKeyframePtr& image : images) {
      if (!image->is_mapped || has_range(image)) continue;
      Drop(image,
           {"no_depth_range",
            Concat("keyframe ", image->frame->id, ": ", DescribeLandmarks(image->frame->landmarks_in_world.size()),
                   ", and no earlier keyframe had a depth range: ",
                   image->frame->landmarks_in_world.empty() ? "" : "if poses and points are read as they are meant, ",
                   "set depth_min and depth_max")});
    }
  }

  /// What cannot be used is told and left out: as a source view it would make the others fail as well.
  void LeaveOutRefused(WindowCapture* capture) {
    std::vector<WindowKeyframePtr> usable;
    for (const WindowKeyframePtr& image : capture->images) {
      const auto failure = CatchFailure([&] {
        CheckFrame(*image->frame);
        CheckPose(Concat("keyframe ", capture->pose->id).c_str(), capture->pose->capture_from_world);
      });
      if (!failure) {
        usable.push_back(image);
      } else if (image->is_mapped) {
        outputs.SubmitDrop(image->frame, *failure, nullptr);
      } else if (capture->images.size() == 1) {
        throw InvalidInputError(failure->message);
      } else {
        outputs.SubmitProblem("companion_refused", failure->message);
      }
    }
    capture->images = std::move(usable);
  }

  /// Sets the range of a capture's image where one is known.
  void FindDepthRange(const WindowKeyframePtr& image, const std::vector<WindowKeyframePtr>& capture) {
    const Frame& frame = *image->frame;
    std::optional<DepthRange> range;
    if (options.use_landmarks) {
      range = DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world);
    }
    if (range) {
      last_range = range;
      had_landmarks = true;
    } else if (!had_landmarks) {
      if (HasDepthRange(options.fallback_depth_range)) {
        image->range = options.fallback_depth_range;
        return;
      }
      if (frame.landmarks_in_world.empty()) FindDepthRangeByMatches(frame, capture);
    }
    if (last_range) image->range = *last_range;
  }

  /// Images and poses are enough once the camera has moved sideways, or where another camera is fixed to it.
  void FindDepthRangeByMatches(const Frame& frame, const std::vector<WindowKeyframePtr>& capture) {
    std::vector<FramePtr> others;
    const RigidTransform world_from_frame = frame.cam_from_world.inverse();
    for (const WindowKeyframePtr& image : capture) {
      const double baseline = (image->frame->cam_from_world * world_from_frame).translation().norm();
      if (baseline > 1e-9 * world_from_frame.translation().norm()) others.push_back(image->frame);
    }
    for (size_t later = 1; later < window.size() && others.size() < kRangeFrames; ++later) {
      others.push_back(window.WithLater(later).images.front()->frame);
    }
    const auto range = DepthRangeFromMatches(frame, others);
    stop->Check();
    if (range && !last_range) {
      outputs.SubmitProblem("depth_range_by_matches",
                            Concat("keyframe ", frame.id, ": no sparse points tell its depth range; by matches with ",
                                   "other images it is ", range->min, " to ", range->max,
                                   ": if that is wrong set depth_min and depth_max"));
    }
    if (range) last_range = range;
  }

  std::string DescribeLandmarks(size_t count) const {
    if (count == 0) return "no sparse points tell its depth range, nor do matches with earlier keyframes yet";
    return Concat("of its ", count, " sparse points fewer than ", kMinDepthLandmarks, " are usable and in view");
  }

  // What received poses are worth.

  /// Where refinement fails poses stay as they are, and that is told.
  template <class Work>
  void RefinePoses(int64_t id, const Work& work) {
    if (const auto failure = CatchFailure(work)) {
      outputs.SubmitProblem("pose_refinement_failed",
                            Concat("poses could not be refined with keyframe ", id, ": ", failure->message));
    }
    HeedContradiction();
  }

  /// Where received poses contradict the images, maps would come to lie anywhere: those of the newest keyframes are
  /// withdrawn. They come back when poses agree again, clearly: by chance those of a lost frontend fit a little better
  /// now and then.
  void HeedContradiction() {
    const double limit = (contradicted ? 0.5 : 1.0) * options.max_contradiction;
    const bool was_contradicted = std::exchange(contradicted, poses.checks().contradiction.value_or(0) > limit);
    if (!contradicted || was_contradicted) return;
    for (size_t later = std::min(kContradictionImages, window.size()); later-- > 0;) {
      for (const WindowKeyframePtr& keyframe : window.WithLater(later).images) {
        if (keyframe->is_withdrawn || !keyframe->refined_score) continue;
        keyframe->is_withdrawn = true;
        outputs.SubmitWithdrawal(keyframe, DescribeContradiction());
      }
    }
  }

  std::string DescribeContradiction() const {
    return Concat(
        "poses contradict the images: motions of the last keyframes put their maps ",
        100 * poses.checks().contradiction.value_or(0), " % of the depth apart, at most ",
        100 * options.max_contradiction,
        " % can be fused; the frontend has lost track, its scale changes, or calibration or stamps are wrong");
  }

  StopRequest never;
  StopRequest* const stop;
  DenseMapperOptions options;
  KeyframeWindow window;
  KeyframeEstimator estimator;
  WindowPoses poses;
  std::optional<DepthRange> last_range;
  bool had_landmarks = false;  ///< that told a depth range
  std::optional<int64_t> last_id;
  bool is_admitted = false;     ///< the last capture: it is in the window
  bool contradicted = false;    ///< received poses, by the images
  std::set<int64_t> tried;      ///< refined again, or not worth it, since the last capture
  std::set<int64_t> made_anew;  ///< initial estimates, since then
  LeftOut left_out;             ///< without poses
  MapperOutputs outputs;        ///< last: its jobs are done before what is above goes
};

DenseMapper::DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks,
                         DepthEngine* output_engine, StopRequest* stop) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  if (output_engine == engine) throw InvalidInputError("output_engine: must not be the engine of the passes");
  Validate(options);
  impl_ = std::make_unique<Impl>(engine, options, std::move(callbacks), output_engine, stop);
}

DenseMapper::~DenseMapper() = default;

void DenseMapper::set_options(const DenseMapperOptions& options) {
  Validate(options);
  impl_->options = options;
  impl_->estimator.set_options(options.pipeline);
  impl_->window.set_max_source_views(options.max_source_views);
}

void DenseMapper::AddCapture(const Capture& capture) { impl_->Add(capture); }

void DenseMapper::AddKeyframe(FramePtr frame) { AddCapture({{std::move(frame)}, {}}); }

bool DenseMapper::CatchUp() { return impl_->CatchUp(); }

void DenseMapper::Flush() { impl_->Flush(); }

void DenseMapper::Reset() {
  impl_->outputs.WaitForAll();
  // Emptied first: the mapper is in order even if a callback throws.
  const KeyframeWindow forgotten = std::exchange(impl_->window, KeyframeWindow(impl_->options.max_source_views));
  impl_->poses.Reset();
  impl_->last_range.reset();
  impl_->had_landmarks = false;
  impl_->last_id.reset();
  impl_->contradicted = false;
  impl_->left_out = {};
  for (const WindowKeyframePtr& keyframe : forgotten.Images()) {
    if (keyframe->state == WindowKeyframe::State::kFinished) continue;
    impl_->Drop(keyframe, ForgottenByReset(*keyframe->frame));
  }
  impl_->outputs.WaitForAll();
}

void DenseMapper::WaitForOutputs() { impl_->outputs.WaitForAll(); }

PoseChecks DenseMapper::pose_checks() const { return impl_->poses.checks(); }

LeftOut DenseMapper::left_out() const {
  LeftOut left_out = impl_->left_out;
  left_out.poses = impl_->poses.left_out();
  return left_out;
}

double DenseMapper::scene_depth() const { return impl_->last_range ? TypicalDepth(*impl_->last_range) : 0; }

void WarmUp(DepthEngine* engine, DenseMapperOptions options, DepthEngine* output_engine, StopRequest* stop) {
  constexpr int kWidth = 128, kHeight = 96;
  constexpr double kBaseline = 0.2;  // 1/5 to 1/20 of the depths
  options.poses.refine = RefinePoses::kOff;
  options.fallback_depth_range = {1, 4};
  DenseMapper mapper(engine, options, {}, output_engine, stop);
  std::minstd_rand random;
  ColorImage image(kWidth, kHeight);
  for (Rgb& pixel : image) pixel.r = pixel.g = pixel.b = static_cast<unsigned char>(random() >> 16);
  const PinholeCamera camera = {kWidth, kHeight, kWidth, kWidth, 0.5 * kWidth, 0.5 * kHeight};
  for (int i = 0; i < options.max_source_views + 2; ++i) {
    RigidTransform pose = RigidTransform::Identity();
    pose.translation().x() = kBaseline * i;
    mapper.AddKeyframe(std::make_shared<const Frame>(MakeFrame(i, i, image.Clone(), camera, pose, {}, kWidth, {}, {})));
  }
  mapper.Flush();
}

}  // namespace acmp
