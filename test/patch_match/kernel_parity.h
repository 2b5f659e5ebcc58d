#pragma once

#include <vector>

#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// One call of the per-pixel functions.
struct ParityQuery {
  int col, row, view;
  PlaneHypothesis plane;
};

struct ParityAnswer {
  float bilinear_cost;        ///< photometric cost with explicit interpolation in float32
  float texture_cost;         ///< photometric cost with texture filtering; not set on the CPU
  float other_cost;           ///< AbsoluteDifference with explicit interpolation
  float geometric_error;      ///< px
  uint32_t drawn_views;       ///< mask of a draw among 8 views, half of them of probability zero
  uint32_t impossible_views;  ///< of these, those of probability zero
  int draws;                  ///< sum over all views
};

/// The kernel functions on the CPU and on the GPU. The latter throws ProcessingError when the device fails.
std::vector<ParityAnswer> AnswerOnCpu(const PatchMatchProblem& problem, const std::vector<ParityQuery>& queries);
std::vector<ParityAnswer> AnswerOnGpu(const PatchMatchProblem& problem, const std::vector<ParityQuery>& queries);

}  // namespace acmp
