#pragma once

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/prior_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"

namespace acmp {

/// A hypothesis with what decides it: `cost` is stored (photometric, or eq. 13), `energy` is compared (eq. 1, 7 or 13).
struct RatedHypothesis {
  PlaneHypothesis plane;
  float cost;
  float energy;
};

/// One pixel under update: what all its hypotheses share.
template <class Sampler>
struct PixelUpdate {
  const MatchContext<Sampler>& context;
  int col, row;
  Vec3f ray;
  ReferencePatch patch;
  PixelPrior prior;
  ViewWeights weights;
};

/// Cost of a plane from its per-view photometric costs (`view_cost(j)`, asked only for drawn views): eq. 1, with the
/// geometric term of eq. 13 in geometric passes, and the energy of eq. 7 in the planar-prior pass.
template <Pass kPass, class Sampler, class ViewCost>
ACMP_HOST_DEVICE inline RatedHypothesis Rate(const PixelUpdate<Sampler>& pixel, const PlaneHypothesis& plane,
                                             const ViewCost& view_cost) {
  const MatchContext<Sampler>& context = pixel.context;
  const float depth = PlaneDepth(plane, pixel.ray);
  float sum = 0;
  for (int j = 0; j < context.num_sources; ++j) {
    if (pixel.weights.draws[j] == 0) continue;
    float cost = view_cost(j);
    if constexpr (kPass == Pass::kGeometric) {
      cost += context.options.geometric_weight * GeometricError(context, depth, pixel.col, pixel.row, j);
    }
    sum += static_cast<float>(pixel.weights.draws[j]) * cost;
  }
  RatedHypothesis rated = {plane, sum / static_cast<float>(pixel.weights.sum), 0};
  rated.energy = rated.cost;
  if constexpr (kPass == Pass::kPlanarPrior) {
    const float probability = PriorProbability(pixel.prior, context.options.prior_gamma, depth, plane.normal());
    rated.energy = PriorAssistedCost(rated.cost, probability, context.options.prior_alpha);
  }
  return rated;
}

/// Step "refinement": eq. 12's six hypotheses and, as an option, the normal of the neighbours' depth gradient.
template <Pass kPass, class Sampler>
ACMP_HOST_DEVICE inline void Refine(const PixelUpdate<Sampler>& pixel, RandomStream* random, RatedHypothesis* best) {
  const MatchContext<Sampler>& context = pixel.context;
  const Vec3f& ray = pixel.ray;
  const Vec3f current_normal = best->plane.normal();
  const float current_depth = PlaneDepth(best->plane, ray);

  float random_depth = RandomDepth(context, random);
  Vec3f random_normal = RandomNormal(ray, random);
  if (kPass == Pass::kPlanarPrior && pixel.prior.valid) {
    random_depth = pixel.prior.depth + 3.0f * pixel.prior.sigma_depth * random->NextUniform(-1.0f, 1.0f);
    random_normal = PerturbNormal(pixel.prior.normal, ray, 0.5f * pixel.prior.sigma_normal, random);
  }
  const float perturbed_depth =
      current_depth * (1.0f + context.options.perturb_depth * random->NextUniform(-1.0f, 1.0f));
  const Vec3f perturbed_normal =
      PerturbNormal(current_normal, ray, context.options.perturb_normal_deg * kRadPerDeg, random);

  const int count = context.options.gradient_normal ? 7 : 6;
  for (int i = 0; i < count; ++i) {
    float depth = current_depth;
    Vec3f normal = current_normal;
    if (i == 0 || i == 5) depth = perturbed_depth;
    if (i == 1 || i == 4) depth = random_depth;
    if (i == 2 || i == 5) normal = perturbed_normal;
    if (i == 3 || i == 4) normal = random_normal;
    if (i == 6) normal = GradientNormal(context, pixel.col, pixel.row, ray, current_normal);
    if (!context.InRange(depth)) continue;
    const PlaneHypothesis plane = PlaneThrough(normal, ray, depth);
    if (!(plane.d > 0)) continue;  // exactly edge-on
    const Vec3f dual = PlaneDual(context, plane);
    const RatedHypothesis rated = Rate<kPass>(
        pixel, plane, [&](int j) { return PhotometricCost(context, pixel.patch, dual, pixel.col, pixel.row, j); });
    if (rated.energy < best->energy) *best = rated;
  }
}

/// One checkerboard step for one pixel: propagation, view weights, hypothesis update, refinement. Reads planes, costs
/// and masks of the other colour only and writes its own pixel, so all pixels of one colour may run at once in any
/// order.
template <Pass kPass, class Sampler>
ACMP_HOST_DEVICE inline void UpdatePixel(const MatchContext<Sampler>& context, int col, int row, int iteration) {
  const int pixel_index = row * context.width + col;
  RandomStream random(context.options.seed, static_cast<uint32_t>(pixel_index),
                      context.pass_number * 64u + static_cast<uint32_t>(iteration) + 1u);
  PixelUpdate<Sampler> pixel{context,
                             col,
                             row,
                             context.rays.Ray(static_cast<float>(col), static_cast<float>(row)),
                             LoadReferencePatch(context, col, row),
                             PixelPrior{},
                             ViewWeights{}};
  if constexpr (kPass == Pass::kPlanarPrior) pixel.prior = LoadPrior(context, col, row, pixel.ray);

  PlaneHypothesis hypotheses[kNumRegions + 1];
  int count = CollectCandidates(context, col, row, pixel.ray, hypotheses);
  const int current = count;
  hypotheses[count++] = context.planes(col, row);

  float costs[(kNumRegions + 1) * kMaxSourceViews];
  for (int i = 0; i < count; ++i) {
    const Vec3f dual = PlaneDual(context, hypotheses[i]);
    for (int j = 0; j < context.num_sources; ++j) {
      costs[i * kMaxSourceViews + j] = PhotometricCost(context, pixel.patch, dual, col, row, j);
    }
  }

  float probability[kMaxSourceViews];
  const int voters = context.options.view_weighting == ViewWeighting::kPaper ? count : current;
  for (int j = 0; j < context.num_sources; ++j) {
    const float likelihood = ViewLikelihood(costs + j, kMaxSourceViews, voters, iteration, context.options);
    probability[j] = likelihood > 0 ? likelihood * ViewSmoothness(context, col, row, j) : 0;
  }
  pixel.weights = DrawViews(probability, context.num_sources, context.options.view_draws, &random);
  context.selected_views(col, row) = pixel.weights.mask;
  if (pixel.weights.sum == 0) return;  // no view counts: the pixel keeps its hypothesis and cost

  const auto rate = [&](int i) {
    return Rate<kPass>(pixel, hypotheses[i], [&](int j) {
      return costs[i * kMaxSourceViews + j];  // NOLINT(clang-analyzer-core.uninitialized.UndefReturn): filled above
    });
  };
  RatedHypothesis best = rate(current);
  for (int i = 0; i < current; ++i) {
    const RatedHypothesis rated = rate(i);
    if (rated.energy < best.energy) best = rated;
  }
  Refine<kPass>(pixel, &random, &best);
  context.planes(col, row) = best.plane;
  context.cost(col, row) = best.cost;
}

}  // namespace acmp
