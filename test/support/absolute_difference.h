#pragma once

#include <vector>

#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// Another matching cost than the method's: the weighted mean of absolute differences, 2 from 64 grey levels on.
struct AbsoluteDifference {
  ACMP_HOST_DEVICE static bool IsInformed(const ReferencePatch& /*patch*/, const PatchMatchOptions& /*options*/) {
    return true;
  }
  ACMP_HOST_DEVICE static void Add(const PatchSample& reference, float center, float gray, WindowSums* sums) {
    sums->ws += reference.weight * fabsf(gray - center - reference.value);
  }
  ACMP_HOST_DEVICE static float Of(const WindowSums& sums, const ReferencePatch& patch,
                                   const PatchMatchOptions& /*options*/) {
    return Clamp(sums.ws * patch.inv_sum_weight / 32, 0.0f, kWorstCost);
  }
};

struct AbsoluteDifferenceSampler : BilinearSampler {
  using Cost = AbsoluteDifference;
};

/// A plane of a pixel in a source view, and what it costs.
struct CostQuery {
  int col, row, view;
  PlaneHypothesis plane;
};

ACMP_HOST_DEVICE inline float Cost(const MatchContext<AbsoluteDifferenceSampler>& context, const CostQuery& query) {
  ReferencePatch patch;
  LoadReferencePatch(context, query.col, query.row, context.options.sigma_color, SingleThread(), &patch);
  const Vec3f dual = PlaneDual(context, query.plane);
  PlaneWarp warp;
  float cost;
  if (!PrepareWindow(context, patch, dual, query.col, query.row, query.view, &warp, &cost)) return cost;
  return AbsoluteDifference::Of(SumWindow(context.sampler, query.view, warp, patch), patch, context.options);
}

/// The costs on the GPU. Throws ProcessingError when that fails.
std::vector<float> CostsOnGpu(const PatchMatchProblem& problem, const std::vector<CostQuery>& queries);

}  // namespace acmp
