#pragma once

#include "acmp_mapping/patch_match/kernel/converged.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "acmp_mapping/patch_match/kernel/match_alone.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/pixel_scratch.h"
#include "acmp_mapping/patch_match/kernel/prior_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/surface_break.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"

namespace acmp {

/// A hypothesis with what decides it: `cost` is stored (photometric, or eq. 13), `energy` is compared (eq. 1, 7 or 13).
struct RatedHypothesis {
  PlaneHypothesis plane;
  float cost;
  float energy;
};

/// One pixel under update, as one thread of its group sees it.
template <class Sampler, class Group, Method kMethod = Method::kOurs>
struct PixelUpdate : ComparedPixel<Sampler, Group> {
  using ComparedPixel<Sampler, Group>::ComparedPixel;
  Vec3f ray;
  PixelPrior prior;
  RegionRange regions = kAllRegions;  ///< that candidates come from
  int num_drawn = 0;                  ///< source views with a positive weight
  float total_weight = 0;             ///< of ACMH's views

  /// w_j of eq. 1 of a view: how often it was drawn; in ACMH a weight of its own.
  ACMP_HOST_DEVICE float Weight(int view) const {
    if constexpr (kMethod == Method::kAcmh) {
      return this->scratch->ViewProbability()[view];
    } else {
      return static_cast<float>(this->scratch->Draws()[view]);
    }
  }
  ACMP_HOST_DEVICE float TotalWeight() const {
    if constexpr (kMethod == Method::kAcmh) {
      return total_weight;
    } else {
      return static_cast<float>(this->context.options.view_draws);
    }
  }
};

/// lambda_geo times the reprojection error of eq. 13.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline float GeometricTerm(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                            const PlaneHypothesis& plane, int view) {
  const float depth = PlaneDepth(plane, pixel.ray);
  return pixel.context.options.geometric_weight *
         GeometricError<kMethod>(pixel.context, depth, pixel.col, pixel.row, view);
}

/// Turns the weighted sum of view costs in `cost[i]` into the cost of plane i (eq. 1, or eq. 13 in geometric passes)
/// and its energy (the same, or eq. 7 in the planar-prior pass).
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline void RatePlane(const PixelUpdate<Sampler, Group, kMethod>& pixel, int i) {
  PixelScratch& scratch = *pixel.scratch;
  const float cost = scratch.cost[i] / pixel.TotalWeight();
  float energy = cost;
  if constexpr (kPass == Pass::kPlanarPrior) {
    const PlaneHypothesis plane = scratch.planes[i];
    const float probability = PriorProbability<kMethod>(pixel.prior, pixel.context.options.prior_gamma,
                                                        PlaneDepth(plane, pixel.ray), plane.normal());
    energy = PriorAssistedCost(cost, probability, pixel.context.options.prior_alpha);
  }
  scratch.cost[i] = cost;
  scratch.energy[i] = energy;
}

/// Of the views in the mask those that the costs of the first `matched` candidates do not reject yet. The others get
/// the worst cost for the planes up to `count`: they will not be drawn.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline uint32_t RejectViews(const PixelUpdate<Sampler, Group, kMethod>& pixel, uint32_t views,
                                             int matched, int count) {
  PixelScratch& scratch = *pixel.scratch;
  const int num_sources = pixel.context.num_sources;
  for (int view = 0; view < num_sources; ++view) {
    if ((views >> view & 1u) == 0 ||
        !IsViewRejected(scratch.ViewCost(0) + view, num_sources, matched, DecisiveCosts(pixel.regions))) {
      continue;
    }
    views &= ~(1u << view);
    for (int i = matched; i < count; ++i) scratch.ViewCost(i)[view] = kWorstCost;
  }
  return views;
}

/// The regions' candidates and the pixel's own plane in the scratch, with their photometric costs in those of `views`
/// that can still be drawn. Returns how many; the own plane is the last.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline int MatchCandidates(const PixelUpdate<Sampler, Group, kMethod>& pixel, uint32_t views) {
  PixelScratch& scratch = *pixel.scratch;
  const int num_sources = pixel.context.num_sources;
  int* listed = scratch.DrawnViews();
  int num_views = ListViews(views, num_sources, pixel.group, listed);
  const int candidates = CollectCandidates(pixel.context, pixel.col, pixel.row, pixel.ray, pixel.regions, pixel.group,
                                           scratch.planes, &scratch.count);
  if (pixel.group.Rank() == 0) scratch.planes[candidates] = pixel.context.planes(pixel.col, pixel.row);
  pixel.group.Sync();
  const int count = candidates + 1;
  const auto store = [&](int i, int view, float cost) { scratch.ViewCost(i)[view] = cost; };
  const auto view_of = [&](int k) { return listed[k]; };
  int matched = 0;
  if constexpr (Group::kSize == 1 && kMethod == Method::kOurs) {
    // Rejecting views on the way gives the same bits, but costs a group on the GPU more time than it saves (5 %).
    const int matched_first = DecisiveCosts(pixel.regions) + 1;
    matched = candidates < matched_first ? candidates : matched_first;
    MatchPairs(
        pixel, matched, num_views, [](int i) { return i; }, view_of, store);
    num_views = ListViews(RejectViews(pixel, views, matched, count), num_sources, pixel.group, listed);
  }
  MatchPairs(
      pixel, count - matched, num_views, [&](int i) { return matched + i; }, view_of, store);
  return count;
}

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

/// Depth and normal of a hypothesis; refinement combines two of them.
struct DepthAndNormal {
  float depth;
  Vec3f normal;
};

/// [d_r, n_r] of eq. 12, drawn at random; in our planar-prior pass about the prior.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline DepthAndNormal DrawRandom(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                                  RandomStream* random) {
  DepthAndNormal drawn;
  drawn.depth = RandomDepth(pixel.context, random);
  drawn.normal = RandomNormal(pixel.ray, random);
  if (kMethod == Method::kOurs && kPass == Pass::kPlanarPrior && pixel.prior.valid) {
    drawn.depth = pixel.prior.depth + 3.0f * pixel.prior.lambda_depth * random->NextUniform(-1.0f, 1.0f);
    drawn.normal = PerturbNormal(pixel.prior.normal, pixel.ray, 0.5f * pixel.prior.lambda_normal, random);
  }
  return drawn;
}

/// [d_p, n_p] of eq. 12, drawn near the current one.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline DepthAndNormal DrawPerturbed(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                                     const DepthAndNormal& current, RandomStream* random) {
  const PatchMatchOptions& options = pixel.context.options;
  DepthAndNormal drawn;
  drawn.depth = current.depth * (1.0f + options.perturb_depth * random->NextUniform(-1.0f, 1.0f));
  drawn.normal = PerturbNormal(current.normal, pixel.ray, options.perturb_normal_deg * kRadPerDeg, random);
  return drawn;
}

/// Eq. 12's hypotheses around the current one into the scratch. Returns how many lie within the depth range. In ours
/// only the perturbed ones in geometric passes: random ones that win there mostly do so by luck, on blank surfaces
/// (without them 0.1 to 0.5 points more pixels within 2 cm). In our planar-prior pass after the first iteration too:
/// what a draw about the prior can bring has been tried by then.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline int MakeRefinements(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                            const PlaneHypothesis& plane, int iteration, RandomStream* random) {
  constexpr int kCombinations = 3;  // of the current and another: its depth, its normal, both
  constexpr bool kIsOurs = kMethod == Method::kOurs;
  constexpr int kMaxOthers = kIsOurs && kPass == Pass::kGeometric ? 1 : 2;
  const int num_others = kIsOurs && kPass == Pass::kPlanarPrior && iteration > 0 ? 1 : kMaxOthers;
  const MatchContext<Sampler>& context = pixel.context;
  const DepthAndNormal current = {PlaneDepth(plane, pixel.ray), plane.normal()};
  DepthAndNormal others[kMaxOthers] = {};
  if (num_others == 2) others[kMaxOthers - 1] = DrawRandom<kPass>(pixel, random);
  others[0] = DrawPerturbed(pixel, current, random);

  const int size = kCombinations * num_others;
  ForEach(pixel.group, size, [&](int i) {
    DepthAndNormal combined = current;
    ACMP_UNROLL
    for (int k = 0; k < kMaxOthers; ++k) {
      if (k >= num_others) break;
      const int combination = i - k * kCombinations;
      if (combination == 0 || combination == 2) combined.depth = others[k].depth;
      if (combination == 1 || combination == 2) combined.normal = others[k].normal;
    }
    const PlaneHypothesis refined = PlaneThrough(combined.normal, pixel.ray, combined.depth);
    const bool present = context.InRange(combined.depth) && refined.d > 0;  // d = 0: exactly edge-on
    pixel.scratch->planes[i] = present ? refined : PlaneHypothesis{};
  });
  return RemoveAbsent(pixel.group, size, pixel.scratch->planes, &pixel.scratch->count);
}

/// Drops the planes whose sum has reached their limit from the list of those alive. Returns how many are left.
template <class Group>
ACMP_HOST_DEVICE inline int KeepBelowLimit(const Group& group, int alive, PixelScratch* scratch) {
  group.Sync();
  if (group.Rank() == 0) {
    int kept = 0;
    for (int a = 0; a < alive; ++a) {
      const int i = scratch->alive[a];
      if (scratch->cost[i] < scratch->limit[i]) scratch->alive[kept++] = i;
    }
    scratch->count = kept;
  }
  group.Sync();
  return scratch->count;
}

/// Weighted sum of view costs below which a plane must stay to win over `best_energy`: what follows from eq. 1, 13 or
/// 7, with a margin for rounding.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline float SumLimit(const PixelUpdate<Sampler, Group, kMethod>& pixel, const PlaneHypothesis& plane,
                                       float best_energy) {
  constexpr float kMargin = 1.0f + 1e-5f;
  const PatchMatchOptions& options = pixel.context.options;
  float cost = best_energy;
  if constexpr (kPass == Pass::kPlanarPrior) {
    const float probability =
        PriorProbability<kMethod>(pixel.prior, options.prior_gamma, PlaneDepth(plane, pixel.ray), plane.normal());
    constexpr float kEnergyMargin = 1e-5f;  // energies reach 20: some units in the last place
    const float squared_cost = options.prior_alpha * (best_energy + kEnergyMargin + logf(probability));
    cost = squared_cost > 0 ? sqrtf(squared_cost) : 0;
  }
  return kMargin * cost * pixel.TotalWeight() + 1e-6f;
}

/// Matches the first `count` planes of the scratch in the drawn views, the heaviest first, and leaves out those that
/// can no longer win over `best_energy`: view costs only add up. Returns how many are left; they are listed in `alive`,
/// with their weighted sums in `cost`.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline int MatchWhileBelow(const PixelUpdate<Sampler, Group, kMethod>& pixel, int count,
                                            float best_energy) {
  PixelScratch& scratch = *pixel.scratch;
  ForEach(pixel.group, count, [&](int i) {
    scratch.limit[i] = SumLimit<kPass>(pixel, scratch.planes[i], best_energy);
    scratch.cost[i] = 0;
    scratch.alive[i] = i;
  });
  pixel.group.Sync();
  int alive = count;
  for (int k = 0; k < pixel.num_drawn && alive > 0;) {
    // As many views at once as keep the group busy; one at first, which already decides most.
    int views = k == 0 || alive > Group::kSize ? 1 : Group::kSize / alive;
    views = views < pixel.num_drawn - k ? views : pixel.num_drawn - k;
    const int* drawn = scratch.DrawnViews() + k;
    MatchPairs(
        pixel, alive, views, [&](int a) { return scratch.alive[a]; }, [&](int j) { return drawn[j]; },
        [&](int i, int view, float cost) {
          if constexpr (kPass == Pass::kGeometric) cost += GeometricTerm(pixel, scratch.planes[i], view);
          scratch.ViewCost(i)[view] = pixel.Weight(view) * cost;
        });
    ForEach(pixel.group, alive, [&](int a) {
      const int i = scratch.alive[a];
      for (int j = 0; j < views; ++j) scratch.cost[i] += scratch.ViewCost(i)[drawn[j]];
    });
    k += views;
    alive = KeepBelowLimit(pixel.group, alive, &scratch);
  }
  return alive;
}

/// Step "refinement": rates the new hypotheses and keeps the best.
template <Pass kPass, class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline void Refine(const PixelUpdate<Sampler, Group, kMethod>& pixel, int iteration,
                                    RandomStream* random, RatedHypothesis* best) {
  PixelScratch& scratch = *pixel.scratch;
  const int count = MakeRefinements<kPass>(pixel, best->plane, iteration, random);
  const int alive = MatchWhileBelow<kPass>(pixel, count, best->energy);
  ForEach(pixel.group, alive, [&](int a) { RatePlane<kPass>(pixel, scratch.alive[a]); });
  pixel.group.Sync();
  for (int a = 0; a < alive; ++a) {
    const int i = scratch.alive[a];
    if (scratch.energy[i] < best->energy) *best = {scratch.planes[i], scratch.cost[i], scratch.energy[i]};
  }
}

/// One checkerboard step for one pixel: propagation, view weights, hypothesis update, refinement; nothing for a
/// converged pixel. Reads planes, costs and masks of the other colour only and writes its own pixel, so all pixels of
/// one colour may run at once in any order.
template <Pass kPass, Method kMethod = Method::kOurs, class Sampler, class Group>
ACMP_HOST_DEVICE inline void UpdatePixel(const MatchContext<Sampler>& context, int col, int row, int iteration,
                                         const Group& group, PixelScratch* scratch) {
  constexpr bool kIsOurs = kMethod == Method::kOurs;
  if constexpr (kIsOurs && kPass == Pass::kGeometric) {
    if (SkipsConvergedPixels(context, iteration) && KeepIfConverged(context, col, row, group)) return;
  }
  RandomStream random(context.options.seed, static_cast<uint32_t>(row * context.width + col),
                      context.pass_number * 64u + static_cast<uint32_t>(iteration) + 1u);
  if (group.Rank() == 0) scratch->num_sources = context.num_sources;
  const float sigma_color = kIsOurs && kPass != Pass::kPhotometric && IsSurfaceBroken(context, col, row, group)
                                ? context.options.edge_sigma_color
                                : context.options.sigma_color;
  LoadReferencePatch(context, col, row, sigma_color, group, &scratch->patch);
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
