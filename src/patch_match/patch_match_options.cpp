#include "acmp_mapping/patch_match/patch_match_options.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

void Validate(const PatchMatchOptions& options) {
  constexpr float kTiny = 1e-6f;  // stands for "greater than zero"
  CheckRange("patch_match.photometric_iterations", options.photometric_iterations, 1, 20);
  CheckRange("patch_match.planar_prior_iterations", options.planar_prior_iterations, 1, 20);
  CheckRange("patch_match.geometric_iterations", options.geometric_iterations, 1, 20);
  CheckRange("patch_match.sigma_spatial_px", options.sigma_spatial_px, kTiny, 1e6f);
  CheckRange("patch_match.sigma_color", options.sigma_color, kTiny, 1e6f);
  CheckRange("patch_match.edge_sigma_color", options.edge_sigma_color, kTiny, 1e6f);
  CheckRange("patch_match.edge_bend", options.edge_bend, kTiny, 1e6f);
  CheckRange("patch_match.min_variance", options.min_variance, kTiny, 255.0f * 255.0f);
  CheckRange("patch_match.sigma_view", options.sigma_view, kTiny, 10.0f);
  CheckRange("patch_match.view_smoothness", options.view_smoothness, 0.5f, 1.0f);
  CheckRange("patch_match.view_draws", options.view_draws, 1, 255);
  CheckRange("patch_match.min_neighbours_per_view", options.min_neighbours_per_view, 0, 5);
  CheckRange("patch_match.perturb_depth", options.perturb_depth, kTiny, 0.999f);
  CheckRange("patch_match.perturb_normal_deg", options.perturb_normal_deg, kTiny, 90.0f);
  CheckRange("patch_match.prior_alpha", options.prior_alpha, kTiny, 1e6f);
  CheckRange("patch_match.prior_gamma", options.prior_gamma, kTiny, 1e6f);
  CheckRange("patch_match.prior_sigma_normal_deg", options.prior_sigma_normal_deg, kTiny, 180.0f);
  CheckRange("patch_match.prior_depth_divisor", options.prior_depth_divisor, kTiny, 1e6f);
  CheckRange("patch_match.prior_start_cost", options.prior_start_cost, 0.0f, 2.0f);
  CheckRange("patch_match.geometric_weight", options.geometric_weight, 0.0f, 1e3f);
  CheckRange("patch_match.geometric_max_px", options.geometric_max_px, kTiny, 1e3f);
}

}  // namespace acmp
