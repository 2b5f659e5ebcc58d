#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/pipeline/dense_mapper.h"

namespace acmp {

/// One keyframe of the window. A finished one stays as a source view of others until it is evicted, and then for those
/// refinements that wait and read it.
struct WindowKeyframe {
  enum class State {
    kPending,    ///< waits for source views
    kFast,       ///< the initial estimate is made (by another shard: is on its way), waits for later keyframes
    kScheduled,  ///< its refinement is made or has its place in the order of all, or the keyframe was dropped
  };
  FramePtr frame;
  FrameLandmarksPtr landmarks;  ///< the frame's
  std::optional<SourceViewSelector> selector;
  DepthRange range;
  int shard = 0;  ///< whose it is
  State state = State::kPending;
  EngineImagePtr image;             ///< null until the keyframe is first used as reference or source view
  int image_levels = 0;             ///< levels it was loaded with
  std::optional<StageTimes> times;  ///< of initial estimates made here since the last refinement; none: none ever

  /// What a refinement reads whose turn in the order of all keyframes is now; none: no estimate.
  std::optional<EstimateStage> stage;
  /// Refined before enough later keyframes had come to see what it sees. Geometric passes of others then go on reading
  /// its fast estimate, and `refined` is as the last pass left it, before completion.
  bool few_later = false;
  EngineEstimatePtr fast;  ///< the latest
  EngineEstimatePtr refined;
  std::optional<double> views_score;    ///< sum over the source views of `fast`; none before they were chosen
  double tried_score = 0;               ///< the same of the last attempt to estimate it anew
  std::optional<double> refined_score;  ///< the same of its maps that are out; none: there are none
  int64_t refined_at = 0;               ///< which refinement of the mapper made these maps, counted from 1
  int64_t again_at = 0;                 ///< the same of the last one that was not its first; 0: none
  bool has_read_better_maps = false;    ///< that was for better maps of its source views, not for better views
  bool fast_settled = false;            ///< `fast` is there or will never be
  bool refined_settled = false;
  uint64_t output = 0;  ///< number of the job that ends with its on_refined; 0: none yet

  // Of the thread for outputs; read by others once `output` is done.
  bool had_fast = false;     ///< its on_fast was called
  bool had_refined = false;  ///< its on_refined was called

  std::optional<EstimateStage> StageInPasses() const { return few_later ? EstimateStage::kFast : stage; }

  bool Settled(EstimateStage read) const {
    if (read == EstimateStage::kFast) return fast_settled;
    return refined_settled && (refined != nullptr || fast_settled);
  }
  /// The fast one stands in for a refinement that failed. May be null.
  const EngineEstimatePtr& Estimate(EstimateStage read) const {
    return read == EstimateStage::kRefined && refined != nullptr ? refined : fast;
  }
};
using WindowKeyframePtr = std::shared_ptr<WindowKeyframe>;

/// A refinement with all that it reads, as it stood when its turn came.
struct ScheduledRefinement {
  struct Source {
    WindowKeyframePtr keyframe;
    std::optional<EstimateStage> in_passes;     ///< read by geometric passes
    std::optional<EstimateStage> after_passes;  ///< read by what comes after them: completion, consistency check

    /// The first stage that is still to come.
    std::optional<EstimateStage> Missing() const {
      for (const auto& stage : {in_passes, after_passes}) {
        if (stage && !keyframe->Settled(*stage)) return stage;
      }
      return std::nullopt;
    }
  };
  WindowKeyframePtr keyframe;
  std::vector<Source> sources;  ///< best first
  std::vector<int64_t> source_ids;
  double score = 0;  ///< of the source views, summed
};

}  // namespace acmp
