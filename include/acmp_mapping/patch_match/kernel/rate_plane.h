#pragma once

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"

namespace acmp {

/// What the planar prior says of one pixel.
struct PixelPrior {
  bool valid = false;
  Vec3f normal = {0, 0, 0};
  float depth = 0;
  float lambda_depth = 0;   ///< of eq. 6
  float lambda_normal = 0;  ///< of eq. 6, rad
};

template <class Sampler>
ACMP_HOST_DEVICE inline PixelPrior LoadPrior(const MatchContext<Sampler>& context, int col, int row, const Vec3f& ray) {
  PixelPrior prior;
  const PlaneHypothesis plane = context.prior(col, row);
  if (!(plane.d > 0)) return prior;
  prior.valid = true;
  prior.normal = plane.normal();
  prior.depth = PlaneDepth(plane, ray);
  prior.lambda_depth = (context.depth_max - context.depth_min) / context.options.prior_depth_divisor;
  prior.lambda_normal = context.options.prior_sigma_normal_deg * kRadPerDeg<float>;
  return prior;
}

/// P(theta | theta_p) of eq. 6; gamma alone where there is no prior. Ours reads both lambdas as standard deviations
/// (squared), which makes them agree in dimension.
template <Method kMethod>
ACMP_HOST_DEVICE inline float PriorProbability(const PixelPrior& prior, float gamma, float depth, const Vec3f& normal) {
  if (!prior.valid) return gamma;
  const float depth_difference = depth - prior.depth;
  const float angle = acosf(Clamp(Dot(normal, prior.normal), -1.0f, 1.0f));
  if constexpr (kMethod == Method::kOurs) {
    const float depth_ratio = depth_difference / prior.lambda_depth;
    const float angle_ratio = angle / prior.lambda_normal;
    return gamma + expf(-0.5f * (depth_ratio * depth_ratio + angle_ratio * angle_ratio));
  } else {
    return gamma + expf(-0.5f * (depth_difference * depth_difference / prior.lambda_depth +
                                 angle * angle / prior.lambda_normal));
  }
}

/// c_p-photo of eq. 7.
ACMP_HOST_DEVICE inline float PriorAssistedCost(float photometric_cost, float prior_probability, float alpha) {
  return photometric_cost * photometric_cost / alpha - logf(prior_probability);
}

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

}  // namespace acmp
