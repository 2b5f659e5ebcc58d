#pragma once

#include <vector>

#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/patch_match/patch_match.h"
#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// Milliseconds of wall time per stage of one estimate; kernels_ms is device time where the backend measures it.
struct StageTimes {
  double photometric_ms = 0;
  double prior_construction_ms = 0;  ///< support points, triangulation, raster
  double planar_prior_ms = 0;
  double geometric_ms = 0;
  double kernels_ms = 0;
};

/// Runs Algorithm 1 for one reference image at a time. Not thread-safe; owns nothing but its device buffers.
class DepthEstimator {
 public:
  /// @param patch_match not null, outlives the estimator
  DepthEstimator(PatchMatch* patch_match, const PipelineOptions& options);

  /// Replaces the options; takes effect with the next estimate. Throws InvalidInputError for bad ones.
  void set_options(const PipelineOptions& options);
  const PipelineOptions& options() const { return options_; }

  /// Steps 1-20: photometric pass, planar prior (if in use), planar-prior pass.
  PatchMatchResult EstimateInitial(const Frame& reference, const std::vector<FramePtr>& sources,
                                   const DepthRange& range);

  /// Steps 21-30, one pass: the sources' depth maps (same order as `sources`, null where there is none yet) are read as
  /// they are (Jacobi), so the order in which images are refined does not matter.
  PatchMatchResult RefineGeometric(const Frame& reference, const std::vector<FramePtr>& sources,
                                   const std::vector<const DepthMap*>& source_depths, const DepthRange& range,
                                   const PatchMatchResult& start, int pass);

  const StageTimes& last_times() const { return times_; }

 private:
  PatchMatch* patch_match_;
  PipelineOptions options_;
  StageTimes times_;
};

}  // namespace acmp
