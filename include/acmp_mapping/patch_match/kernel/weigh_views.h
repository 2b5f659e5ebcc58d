#pragma once

#include "acmp_mapping/patch_match/kernel/pixel_update.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"

namespace acmp {

/// Draws the view weights from the candidates' costs in `views`. Returns the drawn views as a mask: 0 where no view
/// counts.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline uint32_t WeighViews(const PixelUpdate<Sampler, Group, kMethod>& pixel, uint32_t views,
                                            int count, int iteration, RandomStream* random) {
  PixelScratch& scratch = *pixel.scratch;
  const MatchContext<Sampler>& context = pixel.context;
  ForEach(pixel.group, context.num_sources, [&](int view) {
    const float* costs = scratch.ViewCost(0) + view;
    float likelihood = 0;
    if constexpr (kMethod == Method::kAcmp) {
      likelihood = SumOfLikelihoods(costs, context.num_sources, count, context.options);
    } else if ((views >> view & 1u) != 0) {
      likelihood = MeanConfidence<kMethod>(costs, context.num_sources, count - 1, iteration,
                                           DecisiveCosts(pixel.regions), context.options);
    }
    scratch.ViewProbability()[view] =
        likelihood > 0 ? likelihood * ViewSmoothness(context, pixel.col, pixel.row, view) : 0;
    scratch.Draws()[view] = 0;
  });
  pixel.group.Sync();
  if (!DrawViews(scratch.ViewProbability(), context.num_sources, context.options.view_draws, pixel.group, random,
                 scratch.Draws())) {
    return 0;
  }
  return ListWeighedViews(scratch.Draws(), context.num_sources, pixel.group, scratch.DrawnViews());
}

/// ACMH's view weights: no random numbers, and the memory of the iteration before in place of the neighbours' views.
/// Returns the views with a positive weight as a mask.
/// @param weighed_most the view that did so before, as a mask; 0: none
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline uint32_t WeighViewsWithMemory(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                                      uint32_t weighed_most, int count, int iteration) {
  PixelScratch& scratch = *pixel.scratch;
  const int num_sources = pixel.context.num_sources;
  ForEach(pixel.group, num_sources, [&](int view) {
    const float confidence = MeanConfidence<kMethod>(scratch.ViewCost(0) + view, num_sources, count - 1, iteration,
                                                     kDecisiveCosts, pixel.context.options);
    scratch.ViewProbability()[view] = WeightWithMemory(confidence, (weighed_most >> view & 1u) != 0);
  });
  pixel.group.Sync();
  return ListWeighedViews(scratch.ViewProbability(), num_sources, pixel.group, scratch.DrawnViews());
}

}  // namespace acmp
