#pragma once

#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/surface_break.h"

namespace acmp {

/// Whether this iteration of a geometric pass leaves settled pixels alone: two have to compare them first, or precision
/// is lost (docs/quality.md).
template <class Sampler>
ACMP_HOST_DEVICE inline bool LeavesSettledPixels(const MatchContext<Sampler>& context, int iteration) {
  constexpr int kThorough = 2;
  return context.past_geometric_iterations + iteration >= kThorough;
}

/// The views that agree with a settled pixel's hypothesis, as a mask; 0 for pixels that are not settled: too few views
/// agree, the surface bends or breaks within the window, or the hypothesis was measured elsewhere (kUnverifiedCost).
template <class Sampler, class Team>
ACMP_HOST_DEVICE inline uint32_t SettledViews(const MatchContext<Sampler>& context, int col, int row,
                                              const Team& team) {
  constexpr float kAgreementPx = 1.0f;
  if (context.options.settled_views == 0 || context.cost(col, row) >= kUnverifiedCost) return 0;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const float depth = PlaneDepth(context.planes(col, row), ray);
  uint32_t agreeing = 0;
  ForEach(team, context.num_sources, [&](int view) {
    if (GeometricError(context, depth, col, row, view) < kAgreementPx) agreeing |= 1u << view;
  });
  agreeing = team.Union(agreeing);
  if (CountBits(agreeing) < context.options.settled_views) return 0;
  return IsSurfaceBroken(context, col, row, team) ? 0 : agreeing;
}

/// True for a settled pixel, which keeps its plane and cost; its selected views are those that agree.
template <class Sampler, class Team>
ACMP_HOST_DEVICE inline bool KeepIfSettled(const MatchContext<Sampler>& context, int col, int row, const Team& team) {
  const uint32_t agreeing = SettledViews(context, col, row, team);
  if (agreeing == 0) return false;
  if (team.Rank() == 0) context.selected_views(col, row) = agreeing;
  return true;
}

}  // namespace acmp
