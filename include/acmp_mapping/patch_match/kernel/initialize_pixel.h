#pragma once

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/hypothesis.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/rate_plane.h"

namespace acmp {

/// Mean of the min(4, valid) smallest view costs, and which views those were; of ACMH only the best. No valid view:
/// worst cost, no view.
template <Pass kPass, Method kMethod = Method::kOurs, class Sampler, class Group>
ACMP_HOST_DEVICE inline float InitialCost(const MatchContext<Sampler>& context, int col, int row,
                                          const PlaneHypothesis& plane, const Group& group, PixelScratch* scratch,
                                          uint32_t* selected_views) {
  constexpr int kBestViews = 4;
  constexpr float kInvalid = 1e30f;
  if (group.Rank() == 0) scratch->num_sources = context.num_sources;
  LoadUnmaskedPatch(context, col, row, context.options.sigma_color, group, &scratch->patch);
  const float depth = PlaneDepth(plane, context.rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  if (group.Rank() == 0) scratch->planes[0] = plane;
  group.Sync();
  float* view_cost = scratch->ViewCost(0);
  MatchPairs(
      ComparedPixel<Sampler, Group>(context, col, row, group, scratch), 1, context.num_sources, [](int i) { return i; },
      [](int k) { return k; },
      [&](int, int view, float cost) {
        if (!(cost < kWorstCost)) {
          cost = kInvalid;
        } else if constexpr (kPass == Pass::kGeometric) {
          cost += context.options.geometric_weight * GeometricError<kMethod>(context, depth, col, row, view);
        }
        view_cost[view] = cost;
      });

  float best_cost[kBestViews];
  int best_view[kBestViews];
  int valid = 0;
  for (int j = 0; j < context.num_sources; ++j) {
    const float cost = view_cost[j];
    if (!(cost < kInvalid) || (valid == kBestViews && !(cost < best_cost[kBestViews - 1]))) continue;
    int slot = valid < kBestViews ? valid++ : kBestViews - 1;
    for (; slot > 0 && cost < best_cost[slot - 1]; --slot) {
      best_cost[slot] = best_cost[slot - 1];
      best_view[slot] = best_view[slot - 1];
    }
    best_cost[slot] = cost;
    best_view[slot] = j;
  }
  *selected_views = 0;
  if (valid == 0) return kWorstCost;
  float sum = 0;
  for (int i = 0; i < valid; ++i) {
    sum += best_cost[i];
    if (kMethod != Method::kAcmh || i == 0) *selected_views |= 1u << best_view[i];
  }
  return sum / static_cast<float>(valid);
}

template <Pass kPass, Method kMethod = Method::kOurs, class Sampler>
inline float InitialCost(const MatchContext<Sampler>& context, int col, int row, const PlaneHypothesis& plane,
                         uint32_t* selected_views) {
  StackScratch scratch;
  return InitialCost<kPass, kMethod>(context, col, row, plane, SingleThread(), &scratch.shared, selected_views);
}

/// A random plane for the pixel.
template <class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis RandomPlane(const MatchContext<Sampler>& context, const Vec3f& ray,
                                                    RandomStream* random) {
  const float depth = RandomDepth(context, random);
  Vec3f normal = RandomNormal(ray, random);
  PlaneHypothesis plane = PlaneThrough(normal, ray, depth);
  if (!(plane.d > 0)) plane = PlaneThrough({0, 0, -1.0f}, ray, depth);  // exactly edge-on
  return plane;
}

/// The pixel's plane so far; a random one where it has none, which only a mask of coarser pixels leaves.
template <class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis PresentPlane(const MatchContext<Sampler>& context, int col, int row,
                                                     const Vec3f& ray, RandomStream* random) {
  return context.HasNoPlane(col, row) ? RandomPlane(context, ray, random) : context.planes(col, row);
}

/// Where the pixel of our planar-prior pass starts: near the prior if it has one and its estimate is not credible.
template <class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis PriorStart(const MatchContext<Sampler>& context, int col, int row,
                                                   const Vec3f& ray, RandomStream* random) {
  const PlaneHypothesis current = PresentPlane(context, col, row, ray, random);
  const PixelPrior prior = LoadPrior(context, col, row, ray);
  if (!prior.valid || context.cost(col, row) < context.options.prior_start_cost) return current;
  constexpr float kDepthSpread = 0.06f;
  constexpr float kNormalSpread = 5.4f * kRadPerDeg<float>;
  const float depth = Clamp(prior.depth * (1.0f + kDepthSpread * random->NextUniform(-1.0f, 1.0f)), context.depth_min,
                            context.depth_max);
  const PlaneHypothesis plane = PlaneThrough(PerturbNormal(prior.normal, ray, kNormalSpread, random), ray, depth);
  return plane.d > 0 ? plane : current;
}

/// The plane with which a pixel starts a pass: a random one in the papers' photometric and planar-prior passes.
template <Pass kPass, Method kMethod = Method::kOurs, class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis StartingPlane(const MatchContext<Sampler>& context, int col, int row) {
  RandomStream random(context.options.seed, static_cast<uint32_t>(row * context.width + col),
                      context.pass_number * 64u);
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  if constexpr (kPass == Pass::kGeometric) {
    return PresentPlane(context, col, row, ray, &random);
  } else if constexpr (kPass == Pass::kPlanarPrior && kMethod == Method::kOurs) {
    return PriorStart(context, col, row, ray, &random);
  } else {
    return RandomPlane(context, ray, &random);
  }
}

/// First step of a pass for a pixel: its starting plane, cost and selected views. Writes this pixel only.
template <Pass kPass, Method kMethod = Method::kOurs, class Sampler, class Group>
ACMP_HOST_DEVICE inline void InitializePixel(const MatchContext<Sampler>& context, int col, int row, const Group& group,
                                             PixelScratch* scratch) {
  if (LeaveIfMasked(context, col, row, group)) return;
  const PlaneHypothesis plane = StartingPlane<kPass, kMethod>(context, col, row);
  uint32_t selected_views;
  const float cost = InitialCost<kPass, kMethod>(context, col, row, plane, group, scratch, &selected_views);
  if (group.Rank() != 0) return;
  context.cost(col, row) = cost;
  context.planes(col, row) = plane;
  context.selected_views(col, row) = selected_views;
}

template <Pass kPass, Method kMethod = Method::kOurs, class Sampler>
inline void InitializePixel(const MatchContext<Sampler>& context, int col, int row) {
  StackScratch scratch;
  InitializePixel<kPass, kMethod>(context, col, row, SingleThread(), &scratch.shared);
}

/// In ours, the same for a pixel that is updated first: nobody reads its cost and views before its update has set them,
/// so they are not worth a comparison.
template <Pass kPass, class Sampler>
ACMP_HOST_DEVICE inline void InitializeUnmatched(const MatchContext<Sampler>& context, int col, int row) {
  if (LeaveIfMasked(context, col, row, SingleThread())) return;
  context.selected_views(col, row) = 0;
  context.planes(col, row) = StartingPlane<kPass>(context, col, row);
  context.cost(col, row) = kWorstCost;
}

}  // namespace acmp
