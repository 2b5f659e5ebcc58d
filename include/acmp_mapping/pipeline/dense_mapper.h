#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/source_view_selector.h"
#include "acmp_mapping/pipeline/depth_estimator.h"

namespace acmp {

constexpr int kMaxWindowSize = 64;

struct DenseMapperOptions {
  PipelineOptions pipeline;
  SourceViewOptions source_views;
  DepthRangeOptions depth_range;
  DepthRange fallback_depth_range;  ///< used when there are neither landmarks nor a previous range; 0, 0 = none
  int window_size = 30;             ///< keyframes kept to match against, 2..kMaxWindowSize
  int lookahead = 2;         ///< later keyframes a keyframe waits for before its geometric passes, 0..window_size-1
  int reestimates = 1;       ///< keyframes of the window that are estimated anew after each new one, of those for which
                             ///< it brought much better source views, 0..window_size-1; others read what that gives.
                             ///< With several shards none is
  bool refine_again = true;  ///< refine a keyframe again halfway through the window, when it leaves it and at a flush,
                             ///< if by then its source views or their maps are better; not with several shards
  int min_source_views = 2;  ///< a keyframe waits until so many views are useful; at most max_source_views and
                             ///< window_size - 1, which is all that other keyframes can offer
};
void Validate(const DenseMapperOptions& options);

/// Several mappers that get the same keyframes can share the work: keyframe `id` belongs to shard id % count.
struct ShardOptions {
  int index = 0;  ///< which of them this one is, 0..count-1
  int count = 1;  ///< 1..kMaxShards; 1: no sharing
};
constexpr int kMaxShards = 64;
void Validate(const ShardOptions& shard);

enum class EstimateStage {
  kFast,     ///< after steps 1-20
  kRefined,  ///< after the geometric passes
};

/// What shards tell each other about a keyframe that is their own.
struct ShardEstimate {
  int64_t id = 0;
  EstimateStage stage = EstimateStage::kFast;
  EstimateState state;  ///< size of the frame; empty: the keyframe was dropped and gets no estimate of this stage
};

/// Depth of one keyframe with all that belongs to it. Never modified.
struct KeyframeDepth {
  FramePtr frame;
  DepthRange range;
  DepthMap depth;
  // Of refined estimates only; empty for a fast one.
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;
  PointCloud points_in_camera;
  std::vector<int64_t> source_ids;  ///< keyframes it was matched against, best first
  StageTimes times;                 ///< summed over all passes since it was last refined
  double consistency_ms = 0;        ///< wall time of the consistency check, refined estimates only
  bool refined = false;             ///< false: low-latency map of steps 1-20; true: after the geometric passes
};
using KeyframeDepthPtr = std::shared_ptr<const KeyframeDepth>;

/// Why a keyframe (or its refinement) gave no map. `reason` is a short fixed key for counting, `message` a sentence
/// with the values.
/// - "invalid_input": the frame, or the problem made of it, was refused
/// - "no_depth_range": neither landmarks nor an earlier range nor a fallback
/// - "no_source_views": left the window, or was flushed, before enough views of it were useful
/// - "processing_error": device failure or no memory
/// - "reset": forgotten by Reset
struct KeyframeDrop {
  int64_t id = 0;
  std::string reason;
  std::string message;
  bool had_fast = false;  ///< on_fast was called for it: only the refinement is missing
};

/// Online mapping over a sliding window: feed posed frames in time order, get a fast map as soon as enough past views
/// exist, and a refined, consistency-checked map with points once `lookahead` later keyframes have come. A keyframe
/// that was estimated when few views showed what it sees can be estimated anew for others to read (`reestimates`), and
/// refined again halfway through the window, when it leaves it and at a flush (`refine_again`). Deterministic: the same
/// frames, options and device give the same maps and the same calls in the same order, whatever the timing. One thread
/// at a time. The offline tool's online schedule and the nodelet's worker both drive this class.
///
/// With an engine for outputs, maps of finished estimates come to the host, are checked for consistency and go to the
/// callbacks in a thread of the mapper's own, while passes go on: methods return before the callbacks that they cause,
/// but for Flush, Reset and WaitForOutputs.
///
/// As one of several shards it computes its own keyframes only. It follows the schedule of all, which depends on the
/// frames alone, and so knows for each refinement which neighbours a single mapper would read as fast and which as
/// refined estimates. A refinement waits until these have come from their shards (SetPeerEstimate): then all shards
/// together make the very maps of a single mapper without these two, in whatever order estimates arrive. This needs
/// the same frames, calls of Flush at the same place among them, and options that do not change between two keyframes
/// that see each other.
class DenseMapper {
 public:
  /// Called inside the mapper's methods, or one at a time in its thread for outputs; empty ones are skipped. They must
  /// neither call the mapper nor throw.
  struct Callbacks {
    std::function<void(const KeyframeDepthPtr&)> on_fast;  ///< at most once per keyframe, before its on_refined
    std::function<void(const KeyframeDepthPtr&)> on_refined;
    std::function<void(const KeyframeDrop&)> on_drop;  ///< every own keyframe ends in exactly one on_refined or on_drop
    /// Better maps of a keyframe that had its on_refined; may come several times.
    std::function<void(const KeyframeDepthPtr&)> on_refined_again = nullptr;
    /// Asked before each of these, inside the mapper's methods and after the keyframe's on_refined: whether anybody
    /// would use better maps of this keyframe. Empty: yes.
    std::function<bool(int64_t id)> wants_refined_again = nullptr;
    /// With several shards: an own keyframe's estimate for SetPeerEstimate of all others. Each stage at most once; an
    /// empty one when the keyframe is dropped.
    std::function<void(ShardEstimate)> on_own_estimate = nullptr;
    /// What others would have read is missing: a peer's estimate cannot be used ("peer_estimate_refused") or did not
    /// come in time ("peer_estimate_missing"), a keyframe could not be estimated anew ("reestimate_failed") or refined
    /// again ("refine_again_failed"), or its fast maps did not come from the device ("fast_maps_failed").
    std::function<void(const std::string& reason, const std::string& message)> on_problem = nullptr;
  };

  /// @param engine not null, outlives the mapper
  /// @param output_engine shares handles with `engine` (DepthEngine::Share) and outlives the mapper; null: outputs are
  ///   made by `engine`, inside the mapper's methods
  DenseMapper(DepthEngine* engine, const DenseMapperOptions& options, Callbacks callbacks,
              const ShardOptions& shard = {}, DepthEngine* output_engine = nullptr);
  /// Forgets what is unfinished without a callback: Flush or Reset first if it must be accounted for. Waits for a
  /// callback under way.
  ~DenseMapper();

  /// Replaces the options from the next keyframe on. Throws InvalidInputError for bad ones and keeps the old.
  void set_options(const DenseMapperOptions& options);

  /// Adds a keyframe (id above all earlier ones since the last Reset, else InvalidInputError) and runs what has become
  /// possible: first estimates of keyframes that now have enough views, re-estimates, refinements, further ones of the
  /// keyframe halfway through the window and of what has left it; first estimates and refinements in the order of ids.
  /// A keyframe that fails is reported through on_drop and never stops the others. With several shards all of them get
  /// every keyframe under the same id.
  void AddKeyframe(FramePtr frame);

  /// Finishes everything that waits for later keyframes, with the views there are: one useful view is enough. What
  /// waits for other shards goes on waiting.
  /// @param refine_again then what is finished, too, where source views have become better, and what reads that:
  ///   estimated anew, refined as the offline schedule does it, all side by side, and once more one after the other
  void Flush(bool refine_again = true);

  /// Forgets window, pending keyframes (each is reported as dropped with reason "reset"), depth range and ids.
  /// Estimates that other shards sent of later keyframes are kept until an id above theirs comes.
  void Reset();

  /// An estimate of another shard, of a keyframe that may be still to come here, and what becomes possible with it. One
  /// that nobody will read is ignored. Throws InvalidInputError for an id that is this shard's own.
  void SetPeerEstimate(ShardEstimate estimate);

  /// Gives up on what the oldest waiting refinement lacks: from now on nothing waits for those shards until they send
  /// again. Refinements go on with the estimates there are, each lack told by on_problem.
  void StopWaiting();

  /// Returns when all callbacks that earlier calls cause have been called.
  void WaitForOutputs();

  /// Own refinements that wait for estimates of other shards, and the oldest's keyframe.
  size_t waiting() const;
  std::optional<int64_t> oldest_waiting() const;

  /// Own keyframes that have had neither on_refined nor on_drop yet; those on their way to it count as having had it.
  size_t unfinished() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace acmp
