#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/geometry/refined_camera.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/pose_refinement/pose_fit.h"

namespace acmp {

/// How maps that were made with refined poses lie in the frontend's world.
struct PlacedPose {
  RigidTransform cam_from_world = RigidTransform::Identity();
  float scale = 1;  ///< of their depths
  std::optional<RefinedCamera> refined;
  PoseFit fit;
};

struct WindowKeyframe;

/// How a source view lay to the keyframe whose maps were matched with it.
struct MatchedView {
  std::weak_ptr<const WindowKeyframe> source;
  RigidTransform source_from_reference = RigidTransform::Identity();
};

/// One keyframe of the window. A finished one stays as a source view of others until it leaves.
struct WindowKeyframe {
  enum class State {
    kPending,      ///< waits for source views
    kInitialised,  ///< has its initial estimate, waits for later keyframes
    kFinished,     ///< was refined or dropped
  };
  FramePtr frame;
  DepthRange range;
  State state = State::kPending;
  bool is_mapped = true;      ///< false: it is a source view of others alone
  bool is_withdrawn = false;  ///< its refined maps must not be used, since received poses contradict the images

  std::optional<RigidTransform> refined_pose;  ///< cam_from_world to match with; none: the frame's
  PlacedPose placed;                           ///< where that puts the maps in the frontend's world

  EngineImagePtr image;       ///< null until the keyframe is first used as reference or source view
  int image_levels = 0;       ///< levels it was loaded with
  EngineEstimatePtr initial;  ///< after step 0 of the schedule; null: none, or no longer needed
  EngineEstimatePtr refined;  ///< after all steps; null: none
  EngineEstimatePtr shared;   ///< while it is refined side by side with others: after the last step; else null
  StageTimes times;           ///< of initial estimates since the last refinement

  /// Refined before enough later keyframes had come to see what it sees (RefinementPolicy). Passes of others then go on
  /// reading its initial estimate, and `refined` is as the last pass left it, before what is unverified was filled.
  bool lacks_future_views = false;

  std::vector<MatchedView> initial_views;  ///< of `initial`
  std::vector<MatchedView> refined_views;  ///< of `refined`

  // What decides about refining it again (RefinementPolicy). Scores are gains of all source views (SelectSourceViews).
  double initial_score = 0;             ///< of the views of its initial estimate
  std::optional<double> refined_score;  ///< of the views of its refined maps; none: there are none
  int64_t refined_at = 0;               ///< which refinement of the mapper made these, counted from 1
  int64_t refined_again_at = 0;         ///< the same, if it was not the keyframe's first; 0: none
  bool has_read_better_maps = false;    ///< its last refinement was for better maps of its source views

  // Of the thread of outputs.
  bool had_fast = false;     ///< its on_fast was called
  bool had_refined = false;  ///< its on_refined was called

  const RigidTransform& cam_from_world() const { return refined_pose ? *refined_pose : frame->cam_from_world; }

  /// What geometric passes of other keyframes read; may be null.
  const EngineEstimatePtr& EstimateForPasses() const {
    if (shared) return shared;
    return refined && !lacks_future_views ? refined : initial;
  }
  /// What is read after these: to fill what is unverified, and for the consistency check; may be null.
  const EngineEstimatePtr& EstimateAfterPasses() const {
    if (shared) return shared;
    return refined ? refined : initial;
  }
};
using WindowKeyframePtr = std::shared_ptr<WindowKeyframe>;

}  // namespace acmp
