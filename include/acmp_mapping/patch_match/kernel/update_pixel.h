#pragma once

#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/rate_plane.h"
#include "acmp_mapping/patch_match/kernel/refine_pixel.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"

namespace acmp {

/// The regions' candidates and the pixel's own plane in the scratch, with their photometric costs in `views`. Returns
/// how many; the own plane is the last.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline int MatchCandidates(const PixelUpdate<Sampler, Group, kMethod>& pixel, uint32_t views) {
  PixelScratch& scratch = *pixel.scratch;
  const int num_sources = pixel.context.num_sources;
  int* listed = scratch.DrawnViews();
  const int num_views = ListViews(views, num_sources, pixel.group, listed);
  const int candidates = CollectCandidates(pixel.context, pixel.col, pixel.row, pixel.ray, pixel.regions, pixel.group,
                                           scratch.planes, &scratch.count);
  if (pixel.group.Rank() == 0) scratch.planes[candidates] = pixel.context.planes(pixel.col, pixel.row);
  pixel.group.Sync();
  const int count = candidates + 1;
  MatchPairs(
      pixel, count, num_views, [](int i) { return i; }, [&](int k) { return listed[k]; },
      [&](int i, int view, float cost) { scratch.ViewCost(i)[view] = cost; });
  return count;
}

/// The best of the candidates and the pixel's own plane; the own plane wins ties.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline RatedHypothesis BestCandidate(const PixelUpdate<Sampler, Group, kMethod>& pixel, int count) {
  PixelScratch& scratch = *pixel.scratch;
  if constexpr (kPass == Pass::kGeometric) {
    ForEachPair(pixel.group, count, pixel.num_drawn, [&](int i, int k) {
      const int view = scratch.DrawnViews()[k];
      scratch.ViewCost(i)[view] += GeometricTerm(pixel, scratch.planes[i], view);
    });
    pixel.group.Sync();
  }
  ForEach(pixel.group, count, [&](int i) {
    float sum = 0;
    for (int k = 0; k < pixel.num_drawn; ++k) {
      const int view = scratch.DrawnViews()[k];
      sum += pixel.Weight(view) * scratch.ViewCost(i)[view];
    }
    scratch.cost[i] = sum;
    RatePlane<kPass>(pixel, i);
  });
  pixel.group.Sync();
  int best = count - 1;
  for (int i = 0; i < count - 1; ++i) {
    if (scratch.energy[i] < scratch.energy[best]) best = i;
  }
  const RatedHypothesis rated = {scratch.planes[best], scratch.cost[best], scratch.energy[best]};
  pixel.group.Sync();  // the planes are overwritten next
  return rated;
}

/// One checkerboard step for one pixel: propagation, view weights, hypothesis update, refinement; nothing for a
/// pixel that the mask ignores. Reads planes, costs and masks of the other colour only and writes its
/// own pixel, so all pixels of one colour may run at once in any order.
template <Pass kPass, Method kMethod = Method::kOurs, class Sampler, class Group>
ACMP_HOST_DEVICE inline void UpdatePixel(const MatchContext<Sampler>& context, int col, int row, int iteration,
                                         const Group& group, PixelScratch* scratch) {
  constexpr bool kIsOurs = kMethod == Method::kOurs;
  if (LeaveIfMasked(context, col, row, group)) return;
  RandomStream random(context.options.seed, static_cast<uint32_t>(row * context.width + col),
                      context.pass_number * 64u + static_cast<uint32_t>(iteration) + 1u);
  if (group.Rank() == 0) scratch->num_sources = context.num_sources;
  const float sigma_color = kIsOurs && kPass != Pass::kPhotometric && IsSurfaceBroken(context, col, row, group)
                                ? context.options.edge_sigma_color
                                : context.options.sigma_color;
  LoadUnmaskedPatch(context, col, row, sigma_color, group, &scratch->patch);
  PixelUpdate<Sampler, Group, kMethod> pixel(context, col, row, group, scratch);
  pixel.ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  if constexpr (kPass == Pass::kPlanarPrior) pixel.prior = LoadPrior(context, col, row, pixel.ray);

  uint32_t views = AllViews(context.num_sources);
  if constexpr (kIsOurs && kPass != Pass::kPhotometric) {
    if (context.options.min_neighbours_per_view > 0) views = ViewsOfNeighbours(context, col, row);
    pixel.regions = AlternatingRegions(col, row, context.pass_number + static_cast<uint32_t>(iteration));
  }
  const int count = MatchCandidates(pixel, views);
  uint32_t weighed;
  if constexpr (kMethod == Method::kAcmh) {
    weighed = WeighViewsWithMemory(pixel, context.selected_views(col, row), count, iteration);
    pixel.num_drawn = CountBits(weighed);
    for (int k = 0; k < pixel.num_drawn; ++k) pixel.total_weight += pixel.Weight(scratch->DrawnViews()[k]);
  } else {
    weighed = WeighViews(pixel, views, count, iteration, &random);
    pixel.num_drawn = CountBits(weighed);
  }
  const uint32_t remembered = kMethod == Method::kAcmh && weighed != 0 ? 1u << scratch->DrawnViews()[0] : weighed;
  if (group.Rank() == 0) context.selected_views(col, row) = remembered;
  if (weighed == 0) {  // no view counts: the pixel keeps its hypothesis, which others are not to take over
    if (group.Rank() == 0) context.cost(col, row) = kWorstCost;
    return;
  }

  RatedHypothesis best = BestCandidate<kPass>(pixel, count);
  Refine<kPass>(pixel, iteration, &random, &best);
  if (group.Rank() != 0) return;
  context.planes(col, row) = best.plane;
  context.cost(col, row) = best.cost;
}

template <Pass kPass, Method kMethod = Method::kOurs, class Sampler>
inline void UpdatePixel(const MatchContext<Sampler>& context, int col, int row, int iteration) {
  StackScratch scratch;
  UpdatePixel<kPass, kMethod>(context, col, row, iteration, SingleThread(), &scratch.shared);
}

}  // namespace acmp
