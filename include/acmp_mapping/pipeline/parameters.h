#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// Calls visit(name, option) for every option of the pipeline. Names are those of the nodelet's parameters.
template <class Options, class Visitor>
void VisitPipelineParameters(Options& pipeline, const Visitor& visit) {
  auto& match = pipeline.patch_match;
  visit("sharpening", pipeline.sharpening);
  visit("start_level", pipeline.start_level);
  visit("photometric_iterations", match.photometric_iterations);
  visit("full_size_iterations", pipeline.full_size_iterations);
  visit("planar_prior_iterations", match.planar_prior_iterations);
  visit("geometric_iterations", match.geometric_iterations);
  visit("geometric_passes", pipeline.geometric_passes);
  visit("use_planar_prior", pipeline.use_planar_prior);
  visit("seed", match.seed);
  visit("sigma_spatial_px", match.sigma_spatial_px);
  visit("sigma_color", match.sigma_color);
  visit("edge_sigma_color", match.edge_sigma_color);
  visit("edge_bend", match.edge_bend);
  visit("min_variance", match.min_variance);
  visit("sigma_view", match.sigma_view);
  visit("view_smoothness", match.view_smoothness);
  visit("view_draws", match.view_draws);
  visit("candidate_view_votes", match.candidate_view_votes);
  visit("settled_views", match.settled_views);
  visit("perturb_depth", match.perturb_depth);
  visit("perturb_normal_deg", match.perturb_normal_deg);
  visit("geometric_weight", match.geometric_weight);
  visit("geometric_max_px", match.geometric_max_px);

  visit("prior_alpha", match.prior_alpha);
  visit("prior_gamma", match.prior_gamma);
  visit("prior_sigma_normal_deg", match.prior_sigma_normal_deg);
  visit("prior_depth_divisor", match.prior_depth_divisor);
  visit("prior_start_cost", match.prior_start_cost);
  auto& prior = pipeline.planar_prior;
  visit("prior_cell_size_px", prior.cell_size_px);
  visit("prior_max_support_cost", prior.max_support_cost);
  visit("prior_max_grazing_angle_deg", prior.max_grazing_angle_deg);

  auto& completion = pipeline.completion;
  visit("completion", completion.enabled);
  visit("completion_between_passes", completion.between_passes);
  visit("completion_anchor_views", completion.anchor_views);
  visit("completion_max_reprojection_px", completion.max_reprojection_px);
  visit("completion_max_relative_depth", completion.max_relative_depth);
  visit("completion_alternatives", completion.alternatives);
  visit("completion_surest_first", completion.surest_first);
  visit("completion_refute_unsupported", completion.refute_unsupported);
  visit("weighted_median", completion.weighted_median);

  auto& fusion = pipeline.fusion;
  visit("max_reprojection_px", fusion.max_reprojection_px);
  visit("max_relative_depth", fusion.max_relative_depth);
  visit("max_normal_angle_deg", fusion.max_normal_angle_deg);
  visit("min_consistent_views", fusion.min_consistent_views);
  visit("dynamic_consistency", fusion.dynamic_consistency);
  visit("min_point_confidence", fusion.min_point_confidence);
}

/// "name=value": sets that option. Booleans are true or false, enumerations their numbers. Throws InvalidInputError for
/// an unknown name, with the most similar one, and for a value of another type; bounds are Validate's.
void SetParameter(const std::string& assignment, PipelineOptions* options);

}  // namespace acmp
