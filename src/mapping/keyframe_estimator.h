#pragma once

#include <vector>

#include "acmp_mapping/pipeline/depth_estimator.h"
#include "keyframe_window.h"

namespace acmp {

/// A finished estimate with all that its maps and points are made of.
struct FinishedEstimate {
  EngineProblem problem;            ///< the reference's estimate is the one; the sources' are for the consistency check
  std::vector<int64_t> source_ids;  ///< best first
  StageTimes times;
};

/// Takes keyframes of the window through the steps of the schedule: step 0 is the initial estimate, all others together
/// are a refinement.
class KeyframeEstimator {
 public:
  /// @param engine not null, outlives this
  KeyframeEstimator(MatchingEngine* engine, const PipelineOptions& options)
      : engine_(engine), estimator_(engine, options) {}

  void set_options(const PipelineOptions& options) { estimator_.set_options(options); }

  /// Makes keyframe->initial. What it throws leaves the keyframe as it was.
  FinishedEstimate Initialise(WindowKeyframe* keyframe, const SourceViews& sources);

  /// Makes keyframe->refined from `start`, which is its initial estimate or its last refined one. Source views are read
  /// as they are in the window now. What it throws leaves the keyframe as it was.
  /// @param lacks_future_views what keyframe->lacks_future_views becomes
  FinishedEstimate Refine(WindowKeyframe* keyframe, const SourceViews& sources, const EngineEstimatePtr& start,
                          bool lacks_future_views);

 private:
  EngineView MakeView(WindowKeyframe* keyframe);
  EngineProblem MakeProblem(WindowKeyframe* keyframe, const SourceViews& sources);

  MatchingEngine* engine_;
  DepthEstimator estimator_;
  int64_t refinements_ = 0;  ///< made so far
};

}  // namespace acmp
