#pragma once

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/kernel/rate_plane.h"

namespace acmp {

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
  drawn.normal = PerturbNormal(current.normal, pixel.ray, options.perturb_normal_deg * kRadPerDeg<float>, random);
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

}  // namespace acmp
