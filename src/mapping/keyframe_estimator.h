#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/pipeline/depth_estimator.h"
#include "keyframe_window.h"

namespace acmp {

/// A finished estimate with all that its maps and points are made of.
struct FinishedEstimate {
  EngineProblem problem;            ///< the reference's estimate is the one; the sources' are for the consistency check
  std::vector<int64_t> source_ids;  ///< best first
  PlacedPose placed;
  StageTimes times;
  std::string prior_depth_rejection = {};  ///< why the frame's prior depth is used nowhere; else empty
};

/// A keyframe on its way through the steps of a refinement.
struct KeyframeRefinement {
  WindowKeyframePtr keyframe;
  SourceViews sources;
  EngineProblem problem = {};           ///< the reference's estimate is that of the last step taken
  bool lacks_future_views = false;      ///< what the keyframe's becomes
  EngineEstimatePtr after_passes = {};  ///< if it lacks future views: before what is unverified was filled
  StageTimes times = {};
  std::string prior_depth_rejection = {};  ///< of the last step that filled
};

/// Takes keyframes of the window through the steps of the schedule: step 0 is the initial estimate, all others together
/// are a refinement.
class KeyframeEstimator {
 public:
  /// @param engine not null, outlives this
  KeyframeEstimator(DepthEngine* engine, const PipelineOptions& options)
      : engine_(engine), estimator_(engine, options) {}

  void set_options(const PipelineOptions& options) { estimator_.set_options(options); }

  /// Makes keyframe->initial. What it throws leaves the keyframe as it was.
  FinishedEstimate Initialise(WindowKeyframe* keyframe, const SourceViews& sources);

  /// A refinement is Begin, from keyframe->initial, all steps from 1 to num_steps() - 1 in order, and Finish, which
  /// makes keyframe->refined. Each step reads the source views as they are in the window then. What one of these throws
  /// leaves the keyframe as it was.
  KeyframeRefinement Begin(const WindowKeyframePtr& keyframe, const SourceViews& sources, bool lacks_future_views);
  void Step(size_t step, KeyframeRefinement* refinement);
  FinishedEstimate Finish(KeyframeRefinement refinement);

  size_t num_steps() const { return estimator_.schedule().size(); }

 private:
  /// Where something has moved since other captures were taken, the refinement takes what its own capture says alone
  /// (FindMovedPixels).
  void KeepInstant(KeyframeRefinement* refinement);
  EngineView MakeView(WindowKeyframe* keyframe);
  EngineProblem MakeProblem(WindowKeyframe* keyframe, const SourceViews& sources);

  DepthEngine* engine_;
  DepthEstimator estimator_;
};

}  // namespace acmp
