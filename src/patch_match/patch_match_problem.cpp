#include "acmp_mapping/patch_match/patch_match_problem.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/patch_match_options.h"

namespace acmp {
namespace {

void CheckView(const std::string& name, const MatchView& view) {
  CheckCamera(name.c_str(), view.camera);
  if (view.gray.width != view.camera.width || view.gray.height != view.camera.height || view.gray.data == nullptr) {
    throw InvalidInputError(Concat(name, ": image of ", view.gray.width, " x ", view.gray.height,
                                   " px, but the camera has ", view.camera.width, " x ", view.camera.height));
  }
  if (!view.cam_from_world.matrix().allFinite()) throw InvalidInputError(name + ": pose is not finite");
  if (!view.depth.empty() && (view.depth.width != view.gray.width || view.depth.height != view.gray.height)) {
    throw InvalidInputError(Concat(name, ": depth map of ", view.depth.width, " x ", view.depth.height,
                                   " px for an image of ", view.gray.width, " x ", view.gray.height));
  }
  if (!view.mask_distance.empty() &&
      (view.mask_distance.width != view.gray.width || view.mask_distance.height != view.gray.height)) {
    throw InvalidInputError(Concat(name, ": mask of ", view.mask_distance.width, " x ", view.mask_distance.height,
                                   " px for an image of ", view.gray.width, " x ", view.gray.height));
  }
}

}  // namespace

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

void Check(const PatchMatchProblem& problem) {
  CheckView("reference view", problem.reference);
  CheckDepthRange("depth range", problem.depth_range);  // before the baselines, which are judged by it
  CheckRange("number of source views", static_cast<int>(problem.sources.size()), 1, kMaxSourceViews);
  const Eigen::Vector3d center = problem.reference.cam_from_world.inverse().translation();
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    const std::string name = Concat("source view ", i);
    CheckView(name, problem.sources[i]);
    const double baseline = (problem.sources[i].cam_from_world.inverse().translation() - center).norm();
    // Below a millionth of the nearest depth the view moves by less than a thousandth of a pixel over the whole range.
    if (!(baseline > 1e-6 * problem.depth_range.min)) {
      throw InvalidInputError(
          Concat(name, ": baseline to the reference = ", baseline, ": must be > 0 for depth to be visible"));
    }
  }
}

}  // namespace acmp
