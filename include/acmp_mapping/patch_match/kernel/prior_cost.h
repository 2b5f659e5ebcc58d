#pragma once

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

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

}  // namespace acmp
