#include "acmp_mapping/pipeline/presets.h"

#include <cstdio>
#include <cstdlib>

#include "acmp_mapping/common/error.h"

namespace acmp {

void Validate(const PipelineOptions& options) {
  Validate(options.patch_match);
  Validate(options.planar_prior);
  Validate(options.fusion);
  CheckRange("pipeline.start_level", options.start_level, 0, 2);
  CheckRange("pipeline.full_size_iterations", options.full_size_iterations, 0, 20);
  CheckRange("pipeline.geometric_passes", options.geometric_passes, 0, 10);
}

const std::vector<std::string>& PresetNames() {
  static const std::vector<std::string> names = {"acmh", "acmp_no_geometric", "acmp", "online"};
  return names;
}

PipelineOptions MakePreset(const std::string& name) {
  PipelineOptions options;
  if (name == "acmh") {
    options.use_planar_prior = false;
  } else if (name == "acmp_no_geometric") {
    options.geometric_passes = 0;
  } else if (name == "online") {
    options.start_level = 1;
    options.patch_match.photometric_iterations = 3;
    options.patch_match.planar_prior_iterations = 1;
    options.patch_match.geometric_iterations = 1;
    if (const char* e = getenv("ACMP_X"))
      sscanf(e, "%d,%d,%d,%d,%d,%d,%d,%f,%d,%f", &options.start_level, &options.patch_match.photometric_iterations,
             &options.full_size_iterations, &options.patch_match.planar_prior_iterations, &options.geometric_passes,
             &options.patch_match.geometric_iterations, &options.planar_prior.cell_size_px,
             &options.planar_prior.max_support_cost, &options.patch_match.candidate_view_votes,
             &options.patch_match.perturb_depth);
  } else if (name != "acmp") {
    throw InvalidInputError(Concat("preset = \"", name, "\": must be acmh, acmp_no_geometric or acmp"));
  }
  return options;
}

}  // namespace acmp
