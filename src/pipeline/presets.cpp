#include "acmp_mapping/pipeline/presets.h"

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
    options.patch_match.photometric_iterations = 2;
    options.full_size_iterations = 1;
    options.patch_match.planar_prior_iterations = 1;
    options.patch_match.geometric_iterations = 1;
    options.geometric_passes = 1;
    options.patch_match.candidate_view_votes = 2;
    options.planar_prior.cell_size_px = 8;
  } else if (name != "acmp") {
    throw InvalidInputError(Concat("preset = \"", name, "\": must be acmh, acmp_no_geometric, acmp or online"));
  }
  return options;
}

}  // namespace acmp
