#pragma once

#include "acmp_mapping/patch_match/kernel/match_pairs.h"

namespace acmp {

/// MatchPairs by one thread alone: each step for all planes of a view before the next, since a step's divisions and
/// roots depend on each other but not on those of the other planes, and a processor works on several at once.
template <class Sampler, class PlaneOf, class ViewOf, class Store>
ACMP_HOST_DEVICE inline void MatchPairs(const ComparedPixel<Sampler, SingleThread>& match, int count, int num_views,
                                        const PlaneOf& plane_of, const ViewOf& view_of, const Store& store) {
  const MatchContext<Sampler>& context = match.context;
  const ReferencePatch& patch = match.scratch->patch;
  Vec3f duals[kMaxHypotheses];
  PlaneWarp warps[kMaxHypotheses];
  bool compare[kMaxHypotheses];
  float cost[kMaxHypotheses];
  WindowSums sums[kMaxHypotheses];
  for (int i = 0; i < count; ++i) duals[i] = PlaneDual(context, match.scratch->planes[plane_of(i)]);
  for (int k = 0; k < num_views; ++k) {
    const int view = view_of(k);
    for (int i = 0; i < count; ++i) {
      compare[i] = PrepareWindow(context, patch, duals[i], match.col, match.row, view, &warps[i], &cost[i]);
    }
    for (int i = 0; i < count; ++i) {
      if (compare[i]) sums[i] = SumWindow(context.sampler, view, warps[i], patch);
    }
    for (int i = 0; i < count; ++i) store(plane_of(i), view, compare[i] ? NccCost(context, patch, sums[i]) : cost[i]);
  }
}

}  // namespace acmp
