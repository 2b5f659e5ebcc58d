#pragma once

#include <string>

#include "acmp_mapping/pipeline/depth_estimator.h"
#include "keyframe_window.h"

namespace acmp {

/// A keyframe on its way through steps of the schedule, and what its maps and points are made of afterwards.
struct KeyframeSteps {
  WindowKeyframePtr keyframe;
  SourceViews sources;
  EngineProblem problem = {};  ///< the reference's estimate is that of the last step taken; the sources' are those of
                               ///< the consistency check in the end
  std::optional<RefinedPlace> refined = {};  ///< it was matched with this pose; none: with the frame's
  PoseFit pose_fit = {};                     ///< of that pose
  StageTimes times = {};
  std::string prior_depth_rejection = {};  ///< why the last step that filled used the prior depth nowhere; else empty
  bool lacks_future_views = false;         ///< what the keyframe's becomes
  EngineEstimatePtr after_passes = {};     ///< if it lacks future views: before what is unverified was filled

  /// Of depths, to the frontend's world.
  float scale() const { return refined ? static_cast<float>(refined->scale) : 1; }
};

/// Takes keyframes of the window through the steps of the schedule: step 0 is the initial estimate, all others together
/// are a refinement. What a method throws leaves the keyframe as it was.
class KeyframeEstimator {
 public:
  /// @param engine not null, outlives this
  KeyframeEstimator(DepthEngine* engine, const PipelineOptions& options)
      : engine_(engine), estimator_(engine, options) {}

  void set_options(const PipelineOptions& options) { estimator_.set_options(options); }

  /// Makes keyframe->initial.
  void Initialise(KeyframeSteps* steps);

  /// A refinement is Begin, from keyframe->initial, all steps from 1 to num_steps() - 1 in order, and Finish, which
  /// makes keyframe->refined. Each step reads the source views as they are in the window then.
  void Begin(KeyframeSteps* steps, bool lacks_future_views);
  void Step(size_t step, KeyframeSteps* steps);
  void Finish(KeyframeSteps* steps);

  size_t num_steps() const { return estimator_.schedule().size(); }

 private:
  /// Where something has moved since other captures were taken, the refinement takes what its own capture says alone
  /// (FindMovedPixels).
  void KeepInstant(KeyframeSteps* steps);
  EngineView MakeView(WindowKeyframe* keyframe);
  /// Sets problem and pose, without estimates.
  void SetUp(KeyframeSteps* steps);

  DepthEngine* engine_;
  DepthEstimator estimator_;
};

}  // namespace acmp
