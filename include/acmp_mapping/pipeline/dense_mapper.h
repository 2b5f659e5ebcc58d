#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/source_view_selector.h"
#include "acmp_mapping/pipeline/depth_estimator.h"

namespace acmp {

struct DenseMapperOptions {
  PipelineOptions pipeline;
  SourceViewOptions source_views;
  DepthRangeOptions depth_range;
  DepthRange fallback_depth_range;  ///< used when there are neither landmarks nor a previous range; 0, 0 = none
  int window_size = 10;             ///< keyframes kept to match against, 2..64
  int lookahead = 2;                ///< later keyframes a keyframe waits for before its geometric passes, 0..window_size-1
  int min_source_views = 2;         ///< a keyframe waits until so many views are useful, 1..max_source_views
};
void Validate(const DenseMapperOptions& options);

/// Depth of one keyframe with all that belongs to it. Shared with the mapper's window and never modified.
struct KeyframeDepth {
  FramePtr frame;
  DepthRange range;
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;      ///< refined estimates only; empty for a fast one
  PointCloud points_in_camera;   ///< refined estimates only
  std::vector<int64_t> source_ids;
  StageTimes times;
  bool refined = false;  ///< false: low-latency map of steps 1-20; true: after the geometric passes
};
using KeyframeDepthPtr = std::shared_ptr<const KeyframeDepth>;

/// Why a keyframe (or its refinement) gave no map. `reason` is a short fixed key for counting, `message` a sentence with
/// the values.
struct KeyframeDrop {
  int64_t id = 0;
  std::string reason;
  std::string message;
};

/// Online mapping over a sliding window: feed posed frames in time order, get a fast map as soon as enough past views
/// exist, and a refined, consistency-checked map with points once `lookahead` later keyframes have come. Deterministic:
/// the same frames, options and device give the same maps, whatever the timing. One thread at a time. The offline tool's
/// online schedule and the nodelet's worker both drive this class.
class DenseMapper {
 public:
  struct Callbacks {
    std::function<void(const KeyframeDepthPtr&)> on_fast;
    std::function<void(const KeyframeDepthPtr&)> on_refined;
    std::function<void(const KeyframeDrop&)> on_drop;  ///< every keyframe ends in on_refined or on_drop
  };

  /// @param patch_match not null, outlives the mapper
  DenseMapper(PatchMatch* patch_match, const DenseMapperOptions& options, Callbacks callbacks);
  ~DenseMapper();

  /// Replaces the options from the next keyframe on.
  void set_options(const DenseMapperOptions& options);

  /// Adds a keyframe (id above all earlier ones) and runs what has become possible; the callbacks run inside. A keyframe
  /// that fails is reported through on_drop and never stops the others.
  void AddKeyframe(FramePtr frame);

  /// Finishes everything that waits for later keyframes, with the views there are.
  void Flush();

  /// Forgets window and pending keyframes (each pending one is reported as dropped with reason "reset").
  void Reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace acmp
