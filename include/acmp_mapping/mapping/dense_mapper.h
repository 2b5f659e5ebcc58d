#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fusion/point_losses.h"
#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/keyframe/source_view_selection.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/pose_refinement/pose_fit.h"
#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

namespace acmp {

class StopRequest;

constexpr int kMaxWindowSize = 64;

/// Whether both ends are set: they may be set one after the other.
inline bool HasDepthRange(const DepthRange& range) { return range.min > 0 && range.max > 0; }

struct DenseMapperOptions {
  PipelineOptions pipeline;
  int max_source_views = 10;  ///< 1..kMaxSelectedViews
  PoseRefinementOptions poses;
  DepthRange fallback_depth_range;  ///< used until landmarks tell one; an end of 0: matches tell it
  bool use_landmarks = true;        ///< for depth ranges; false: all keyframes have the fallback
  int window_size = 30;             ///< captures kept to match against, 2..kMaxWindowSize
  int lookahead = 2;                ///< later keyframes a keyframe waits for before it is refined, 0..window_size-1
  bool refine_again = true;  ///< refine a keyframe once more halfway through the window, and at a flush, if by then its
                             ///< source views are better or poses have moved
  /// Nothing on the way of a keyframe but its own work. What makes maps better beside that waits for
  /// DenseMapper::CatchUp (refining again, and what was held back while received poses contradicted the images) or is
  /// taken in when it is ready (refined poses): so results depend on the timing. For cameras; recordings need not be
  /// live.
  bool live = false;
  /// Of the depth: by so much the maps of a surface may lie apart for received poses that contradict the images. Those
  /// of frontends that have not lost track contradict them by 0.2 to 1.5 %.
  double max_contradiction = 0.02;
  int min_source_views = 2;  ///< a keyframe waits until so many views are useful; at most max_source_views and
                             ///< window_size - 1, which is all that other keyframes can offer. One of its own
                             ///< capture is enough: it lies as far away as the cameras do
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const DenseMapperOptions& options);

/// Options of the sliding window that a user can set, without those of its pipeline.
OptionList OptionsOf(DenseMapperOptions* options);

/// Depth of one keyframe with all that belongs to it. Maps have the size of frame->camera. Never modified.
struct KeyframeDepth {
  FramePtr frame;
  /// Where it lies: the frame's, or the refined one where that puts it as the window lay then.
  RigidTransform cam_from_world = RigidTransform::Identity();
  std::optional<RefinedCamera> refined_camera;  ///< none: the pose is the frame's
  PoseFit pose_fit;                             ///< how well that fits; no matches: not measured
  DepthRange range;                             ///< that was searched, scene units
  DepthMap depth;                               ///< z in the camera's frame, scene units
  // Of refined maps only; empty for fast ones.
  NormalMap normal;             ///< unit vectors in the camera's frame, towards the camera
  CostMap cost;                 ///< 0..kWorstCost or kUnsupportedCost, see CostMap
  ConfidenceMap confidence;     ///< 0..1
  PointCloud points_in_camera;  ///< pixels that enough source views confirm
  /// Describe(PointLosses), where no pixel is confirmed: its own, or that of a keyframe shortly before.
  std::optional<std::string> no_points_reason;
  std::string prior_depth_rejection;  ///< why the frame's prior depth is used nowhere; else empty
  std::vector<int64_t> source_ids;    ///< keyframes it was matched against, best first
  StageTimes times;                   ///< summed over all steps since it was last refined
  double consistency_ms = 0;          ///< wall time of the consistency check
  bool refined = false;               ///< false: fast maps of steps 1-20; true: after all steps
};
using KeyframeDepthPtr = std::shared_ptr<const KeyframeDepth>;

/// Why a keyframe gave no refined maps. `reason` is a short fixed key for counting, `message` a sentence with the
/// values.
/// - "invalid_input": the frame, or the problem made of it, was refused
/// - "no_depth_range": neither landmarks nor matches nor an earlier range nor a fallback
/// - "no_source_views": left the window, or was flushed, before enough views of it were useful
/// - "poses_contradict": the received poses contradict the images, and did when it left the window or was flushed
/// - "processing_error": device failure or no memory
/// - "reset": forgotten by Reset
struct KeyframeDrop {
  FramePtr frame;
  std::string reason;
  std::string message;
  bool had_fast = false;  ///< on_fast was called for it: only the refined maps are missing
};

/// What there was no time for, live, since the last Reset.
struct LeftOut {
  uint64_t poses = 0;         ///< keyframes whose pose was not refined: it follows from the one before
  uint64_t second_turns = 0;  ///< keyframes that left the window without their turn to be refined again, or withdrawn
};

/// Online mapping over a sliding window: feed posed frames in time order, get fast maps as soon as enough past views
/// exist, and refined, consistency-checked maps with points once `lookahead` later keyframes have come. The steps of a
/// keyframe are those of ScheduleOf, as in the offline tool; here they read what maps the window has.
///
/// Deterministic, unless it is live: the same frames, options and device give the same maps and the same calls in the
/// same order, whatever the timing. Used by one thread at a time.
///
/// With an engine for outputs, maps of finished estimates come to the host, are checked for consistency and go to the
/// callbacks beside the mapper's thread while further steps run: methods return before the callbacks that they
/// cause, but for Flush, Reset and WaitForOutputs.
class DenseMapper {
 public:
  /// Called inside the mapper's methods, or one at a time beside its thread; empty ones are skipped. They must
  /// neither call the mapper nor throw.
  struct Callbacks {
    std::function<void(const KeyframeDepthPtr&)> on_fast;  ///< at most once per keyframe, before its on_refined
    std::function<void(const KeyframeDepthPtr&)> on_refined;
    std::function<void(const KeyframeDrop&)> on_drop;  ///< every keyframe ends in exactly one on_refined or on_drop
    /// Better maps of a keyframe that had its on_refined; may come several times.
    std::function<void(const KeyframeDepthPtr&)> on_refined_again;
    /// The refined maps of a keyframe must not be used any more: the received poses contradict the images. `maps` has
    /// none. Where poses agree again while the keyframe is in the window, on_refined_again brings new ones.
    std::function<void(const KeyframeDepthPtr& maps, const std::string& message)> on_withdrawn;
    /// Something failed that costs quality, but no keyframe: it could not be refined again ("refine_again_failed"), or
    /// its fast maps did not come from the device ("fast_maps_failed"), or poses could not be refined
    /// ("pose_refinement_failed"), or an image that is only a source view cannot be used ("companion_refused"). And
    /// once the depth range that matches tell, where no landmarks do ("depth_range_by_matches").
    std::function<void(const std::string& reason, const std::string& message)> on_problem;
  };

  /// @param engine not null, outlives the mapper
  /// @param output_engine shares handles with `engine` (DepthEngine::Share) and outlives the mapper; null: outputs are
  ///   made by `engine`, inside the mapper's methods
  /// @param stop outlives the mapper; null: nobody stops it. Once requested, by any thread, methods return soon, on a
  ///   CPU within a pass, and leave what they have not done. Then the mapper is good for Reset only, and after that
  ///   and StopRequest::Clear for all again
  DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks,
              DepthEngine* output_engine = nullptr, StopRequest* stop = nullptr);
  /// Forgets what is unfinished without a callback: Flush or Reset first if it must be accounted for. Waits for a
  /// callback under way.
  ~DenseMapper();

  /// Replaces the options from the next keyframe on. Throws InvalidInputError for bad ones and keeps the old.
  void set_options(const DenseMapperOptions& options);

  /// Adds the images of one time (ids ascend from keyframe to companion, above all earlier ones since the last Reset,
  /// else InvalidInputError) and does what has become possible: initial estimates of keyframes that now have enough
  /// views, refinements of those with `lookahead` later captures, and once more of the keyframe halfway through the
  /// window. A keyframe that fails is reported through on_drop and never stops the others.
  ///
  /// Companions get no maps and no callbacks. They move with the first keyframe's pose, take its depth range where they
  /// are matched, and are source views of their own keyframes where they bring as much as others. For these each gets
  /// an initial estimate, which confirms what both see, and keyframes get another one by their companions alone, which
  /// shows what has moved since other captures. One that cannot be used is told of as a problem, "companion_refused",
  /// and left out.
  ///
  /// A capture without keyframes costs little, for images that come faster than they can be mapped: it is a later
  /// capture to keyframes that wait for some, and its images are source views of others. Where keyframes have maps,
  /// too, these go before them, since only they can confirm depth. Throws InvalidInputError where none can be used.
  void AddCapture(const Capture& capture);

  /// AddCapture of one keyframe.
  void AddKeyframe(FramePtr frame);

  /// Live: does one thing that was put off, which takes about as long as a keyframe, newest keyframes first. False:
  /// there is nothing to do until the next capture. What is still put off when a keyframe leaves the window is left
  /// out, but for its first refined maps.
  bool CatchUp();

  /// Finishes everything that waits for later keyframes, with the views there are: one useful view is enough. Then
  /// refines again what has better views now.
  void Flush();

  /// Forgets window, pending keyframes (each is reported as dropped with reason "reset"), depth range and ids.
  void Reset();

  /// Returns when all callbacks that earlier calls cause have been called.
  void WaitForOutputs();

  /// Faults of the received poses. While they contradict the images by more than max_contradiction, maps of the same
  /// surface would not meet: no keyframe is refined, the maps of the newest ones are withdrawn, and they come when the
  /// contradiction is below half of that again, or never.
  PoseChecks pose_checks() const;

  LeftOut left_out() const;

  /// Where the scene lies: the middle of the depth range that sparse points or matches between images have told last.
  /// 0: nothing has.
  double scene_depth() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Maps a few small images, so that what engines do once in a program (loading kernels, their own buffers) is done
/// before the first keyframe comes. Parameters as DenseMapper's.
void WarmUp(DepthEngine* engine, DenseMapperOptions options, DepthEngine* output_engine, StopRequest* stop);

}  // namespace acmp
