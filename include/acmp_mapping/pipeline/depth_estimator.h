#pragma once

#include "acmp_mapping/pipeline/depth_engine.h"
#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// Milliseconds of wall time per stage of one estimate; kernels_ms is device time where the engine measures it.
struct StageTimes {
  double photometric_ms = 0;
  double prior_construction_ms = 0;  ///< support points and their triangulation
  double planar_prior_ms = 0;
  double geometric_ms = 0;
  double completion_ms = 0;
  double kernels_ms = 0;
  double photometric_kernels_ms = 0;  ///< of these, the photometric pass's

  StageTimes& operator+=(const StageTimes& other);
};

/// Runs Algorithm 1 for one reference image at a time. Not thread-safe.
class DepthEstimator {
 public:
  /// @param engine not null, outlives the estimator
  DepthEstimator(DepthEngine* engine, const PipelineOptions& options);

  /// Replaces the options; takes effect with the next estimate. Throws InvalidInputError for bad ones.
  void set_options(const PipelineOptions& options);
  const PipelineOptions& options() const { return options_; }

  /// Steps 1-20: photometric pass, planar prior (if in use), planar-prior pass. Estimates of the sources are not read.
  EngineEstimatePtr EstimateInitial(const EngineProblem& problem);

  /// How often an initial estimate is refined: geometric passes (steps 21-30), with completions around them if enabled.
  int num_refinements() const { return NumRefinements(options_); }

  /// Refinement `step` (0, 1, ...) of the reference's estimate (RefinementStepOf). The sources' estimates are read as
  /// they are: where all are of the step before (Jacobi), the order of images does not matter.
  EngineEstimatePtr Refine(EngineProblem problem, int step);

  const StageTimes& last_times() const { return times_; }

 private:
  /// The photometric estimate at full size.
  EngineEstimatePtr EstimatePhotometric(const EngineProblem& problem);

  DepthEngine* engine_;
  PipelineOptions options_;
  StageTimes times_;
};

}  // namespace acmp
