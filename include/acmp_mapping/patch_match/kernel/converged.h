#pragma once

#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/surface_break.h"

namespace acmp {

/// Whether this iteration of a geometric pass leaves converged pixels alone: two have to compare them first, or
/// precision is lost.
template <class Sampler>
ACMP_HOST_DEVICE inline bool SkipsConvergedPixels(const MatchContext<Sampler>& context, int iteration) {
  constexpr int kThorough = 2;
  return context.past_geometric_iterations + iteration >= kThorough;
}

/// The views that agree with a converged pixel's hypothesis, as a mask; 0 for pixels that are not converged: too few
/// views agree, the surface bends or breaks within the window, or the hypothesis was measured elsewhere
/// (kUnverifiedCost).
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline uint32_t ConvergedViews(const MatchContext<Sampler>& context, int col, int row,
                                                const Group& group) {
  constexpr float kAgreementPx = 1.0f;
  if (context.options.converged_views == 0 || context.cost(col, row) >= kUnverifiedCost) return 0;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const float depth = PlaneDepth(context.planes(col, row), ray);
  uint32_t agreeing = 0;
  ForEach(group, context.num_sources, [&](int view) {
    if (GeometricError(context, depth, col, row, view) < kAgreementPx) agreeing |= 1u << view;
  });
  agreeing = group.Union(agreeing);
  if (CountBits(agreeing) < context.options.converged_views) return 0;
  return IsSurfaceBroken(context, col, row, group) ? 0 : agreeing;
}

/// True for a converged pixel, which keeps its plane and cost; its selected views are those that agree.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline bool KeepIfConverged(const MatchContext<Sampler>& context, int col, int row,
                                             const Group& group) {
  const uint32_t agreeing = ConvergedViews(context, col, row, group);
  if (agreeing == 0) return false;
  if (group.Rank() == 0) context.selected_views(col, row) = agreeing;
  return true;
}

}  // namespace acmp
