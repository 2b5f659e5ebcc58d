#pragma once

#include <string>
#include <vector>

#include <acmp_mapping/DenseMapperConfig.h>

#include "acmp_mapping/intake/keyframe_gate.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/parameter_reader.h"

namespace acmp {

struct OutputOptions {
  double min_confidence = 0;  ///< refined depth and points below are left out, 0..1; 0 = all
};
void Validate(const OutputOptions& options);

/// What may change while the nodelet runs (dynamic_reconfigure). The worker takes one copy per keyframe.
struct RuntimeOptions {
  DenseMapperOptions mapper;
  KeyframeGateOptions gate;
  OutputOptions output;
};
void Validate(const RuntimeOptions& options);

using acmp_mapping::DenseMapperConfig;

DenseMapperConfig ToConfig(const RuntimeOptions& options);
/// @param options what the configuration does not have: it stays
RuntimeOptions FromConfig(const DenseMapperConfig& config, RuntimeOptions options = {});

/// Parameters of the namespace over the defaults in `start`. Throws InvalidInputError for a value out of the .cfg
/// file's bounds or that does not fit another one.
RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start);

/// Makes a configuration valid: limits parameters by each other and, if that does not help, takes `previous` back.
/// Returns a sentence for each change, for the log.
std::vector<std::string> MakeValid(const DenseMapperConfig& previous, DenseMapperConfig* config);

/// Calls visit(name, option, field) for every parameter: the one list that ties the C++ options to the .cfg file.
template <class Options, class Config, class Visitor>
void VisitRuntimeParameters(Options& options, Config& config, const Visitor& visit) {
  auto& pipeline = options.mapper.pipeline;
  auto& match = pipeline.patch_match;
  visit("sharpening", pipeline.sharpening, config.sharpening);
  visit("start_level", pipeline.start_level, config.start_level);
  visit("photometric_iterations", match.photometric_iterations, config.photometric_iterations);
  visit("full_size_iterations", pipeline.full_size_iterations, config.full_size_iterations);
  visit("planar_prior_iterations", match.planar_prior_iterations, config.planar_prior_iterations);
  visit("geometric_iterations", match.geometric_iterations, config.geometric_iterations);
  visit("geometric_passes", pipeline.geometric_passes, config.geometric_passes);
  visit("use_planar_prior", pipeline.use_planar_prior, config.use_planar_prior);
  visit("seed", match.seed, config.seed);
  visit("sigma_spatial_px", match.sigma_spatial_px, config.sigma_spatial_px);
  visit("sigma_color", match.sigma_color, config.sigma_color);
  visit("edge_sigma_color", match.edge_sigma_color, config.edge_sigma_color);
  visit("edge_bend", match.edge_bend, config.edge_bend);
  visit("min_variance", match.min_variance, config.min_variance);
  visit("sigma_view", match.sigma_view, config.sigma_view);
  visit("view_smoothness", match.view_smoothness, config.view_smoothness);
  visit("view_draws", match.view_draws, config.view_draws);
  visit("candidate_view_votes", match.candidate_view_votes, config.candidate_view_votes);
  visit("settled_views", match.settled_views, config.settled_views);
  visit("perturb_depth", match.perturb_depth, config.perturb_depth);
  visit("perturb_normal_deg", match.perturb_normal_deg, config.perturb_normal_deg);
  visit("geometric_weight", match.geometric_weight, config.geometric_weight);
  visit("geometric_max_px", match.geometric_max_px, config.geometric_max_px);

  visit("prior_alpha", match.prior_alpha, config.prior_alpha);
  visit("prior_gamma", match.prior_gamma, config.prior_gamma);
  visit("prior_sigma_normal_deg", match.prior_sigma_normal_deg, config.prior_sigma_normal_deg);
  visit("prior_depth_divisor", match.prior_depth_divisor, config.prior_depth_divisor);
  visit("prior_start_cost", match.prior_start_cost, config.prior_start_cost);
  auto& prior = pipeline.planar_prior;
  visit("prior_cell_size_px", prior.cell_size_px, config.prior_cell_size_px);
  visit("prior_max_support_cost", prior.max_support_cost, config.prior_max_support_cost);
  visit("prior_max_grazing_angle_deg", prior.max_grazing_angle_deg, config.prior_max_grazing_angle_deg);

  auto& completion = pipeline.completion;
  visit("completion", completion.enabled, config.completion);
  visit("completion_between_passes", completion.between_passes, config.completion_between_passes);
  visit("completion_anchor_views", completion.anchor_views, config.completion_anchor_views);
  visit("completion_max_reprojection_px", completion.max_reprojection_px, config.completion_max_reprojection_px);
  visit("completion_max_relative_depth", completion.max_relative_depth, config.completion_max_relative_depth);
  visit("completion_alternatives", completion.alternatives, config.completion_alternatives);
  visit("completion_surest_first", completion.surest_first, config.completion_surest_first);
  visit("completion_refute_unsupported", completion.refute_unsupported, config.completion_refute_unsupported);
  visit("weighted_median", pipeline.completion.weighted_median, config.weighted_median);

  auto& mapper = options.mapper;
  visit("window_size", mapper.window_size, config.window_size);
  visit("lookahead", mapper.lookahead, config.lookahead);
  visit("reestimates", mapper.reestimates, config.reestimates);
  visit("refine_again", mapper.refine_again, config.refine_again);
  visit("min_source_views", mapper.min_source_views, config.min_source_views);
  visit("max_source_views", mapper.source_views.max_source_views, config.max_source_views);
  visit("min_angle_deg", mapper.source_views.min_angle_deg, config.min_angle_deg);
  visit("best_angle_min_deg", mapper.source_views.best_angle_min_deg, config.best_angle_min_deg);
  visit("best_angle_max_deg", mapper.source_views.best_angle_max_deg, config.best_angle_max_deg);
  visit("min_overlap", mapper.source_views.min_overlap, config.min_overlap);
  visit("min_shared_landmarks", mapper.source_views.min_shared_landmarks, config.min_shared_landmarks);
  visit("depth_quantile", mapper.depth_range.quantile, config.depth_quantile);
  visit("depth_margin", mapper.depth_range.margin, config.depth_margin);
  visit("min_landmarks", mapper.depth_range.min_landmarks, config.min_landmarks);
  visit("depth_min", mapper.fallback_depth_range.min, config.depth_min);
  visit("depth_max", mapper.fallback_depth_range.max, config.depth_max);

  visit("gate_baseline_ratio", options.gate.min_baseline_ratio, config.gate_baseline_ratio);
  visit("gate_angle_deg", options.gate.min_angle_deg, config.gate_angle_deg);
  visit("gate_interval_s", options.gate.max_interval_s, config.gate_interval_s);

  auto& fusion = pipeline.fusion;
  visit("max_reprojection_px", fusion.max_reprojection_px, config.max_reprojection_px);
  visit("max_relative_depth", fusion.max_relative_depth, config.max_relative_depth);
  visit("max_normal_angle_deg", fusion.max_normal_angle_deg, config.max_normal_angle_deg);
  visit("min_consistent_views", fusion.min_consistent_views, config.min_consistent_views);
  visit("dynamic_consistency", fusion.dynamic_consistency, config.dynamic_consistency);
  visit("min_point_confidence", fusion.min_point_confidence, config.min_point_confidence);

  visit("min_confidence", options.output.min_confidence, config.min_confidence);
}

}  // namespace acmp
