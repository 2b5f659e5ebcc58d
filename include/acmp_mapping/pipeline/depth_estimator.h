#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// Milliseconds of wall time per stage of one estimate; kernels_ms is device time where the engine measures it.
struct StageTimes {
  double photometric_ms = 0;
  double prior_construction_ms = 0;  ///< support points and their triangulation
  double planar_prior_ms = 0;
  double geometric_ms = 0;
  double fill_ms = 0;
  double kernels_ms = 0;
  double photometric_kernels_ms = 0;  ///< of these, the photometric pass's

  StageTimes& operator+=(const StageTimes& other);
};

/// Takes one reference image at a time through the steps of the schedule. Not thread-safe.
class DepthEstimator {
 public:
  /// @param engine not null, outlives the estimator
  DepthEstimator(DepthEngine* engine, const PipelineOptions& options);

  /// Replaces the options; takes effect with the next step. Throws InvalidInputError for bad ones.
  void set_options(const PipelineOptions& options);
  const PipelineOptions& options() const { return options_; }

  /// ScheduleOf the options.
  const std::vector<KeyframeStep>& schedule() const { return schedule_; }

  /// Does one step and returns the estimate it makes of the reference.
  /// @param problem the reference's estimate is that of the step before, not read by the first one; if nobody else
  ///   holds it, its memory is reused. The sources' estimates are read as they are; those without one take no part
  EngineEstimatePtr Run(const KeyframeStep& step, EngineProblem problem);

  /// Of the last step.
  const StageTimes& last_times() const { return times_; }
  /// Why the last step, which fills, used the frame's prior depth nowhere; else empty.
  const std::string& prior_depth_rejection() const { return prior_depth_rejection_; }

 private:
  EngineEstimatePtr EstimateInitial(const EngineProblem& problem);
  /// The photometric estimate at full size; with several scales at the coarsest.
  EngineEstimatePtr EstimatePhotometric(const EngineProblem& problem);

  /// The reference's estimate `start`, whose memory is reused if nobody else holds it, with planes for what no view
  /// confirms.
  EngineEstimatePtr Fill(const EngineProblem& problem, EngineEstimatePtr start, bool for_passes);

  DepthEngine* engine_;
  PipelineOptions options_;
  std::vector<KeyframeStep> schedule_;
  StageTimes times_;
  std::string prior_depth_rejection_;
};

}  // namespace acmp
