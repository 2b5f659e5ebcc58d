#include "acmp_mapping/pipeline/presets.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/parameters.h"

namespace acmp {

void Validate(const PipelineOptions& options) {
  Validate(options.patch_match);
  Validate(options.planar_prior);
  Validate(options.completion);
  Validate(options.fusion);
  PipelineOptionTable().Check(options);
  CheckRange("pipeline.start_level", options.start_level, 0, 2);
  CheckRange("pipeline.full_size_iterations", options.full_size_iterations, 0, 20);
}

int NumRefinements(const PipelineOptions& options) {
  if (!options.completion.enabled) return options.geometric_passes;
  return options.geometric_passes > 0 ? options.geometric_passes + 2 : 1;
}

int NumRefinementsInPasses(const PipelineOptions& options) {
  return NumRefinements(options) - (options.completion.enabled ? 1 : 0);
}

RefinementStep RefinementStepOf(const PipelineOptions& options, int step) {
  CheckRange("refinement step", step, 0, NumRefinements(options) - 1);
  if (!options.completion.enabled) return {false, step};
  if (step == NumRefinements(options) - 1) return {true, std::nullopt, options.completion.refute_unsupported};
  if (step == 0) return {true, std::nullopt};
  return {step > 1 && options.completion.between_passes, step - 1};
}

CompletionOptions CompletionOptionsOf(const PipelineOptions& options, int step) {
  CheckRange("refinement step", step, 0, NumRefinements(options) - 1);
  CompletionOptions completion = options.completion;
  // After the passes nobody is left to choose, or to check what comes from afar.
  const bool is_checked = step < NumRefinementsInPasses(options);
  completion.alternatives = completion.alternatives && is_checked;
  completion.surest_first = completion.surest_first && is_checked;
  completion.hide_nothing_evident = completion.hide_nothing_evident && is_checked;
  return completion;
}

const std::vector<std::string>& PresetNames() {
  static const std::vector<std::string> names = {"acmh",  "acmp_no_geometric", "acmp",  "acmm",
                                                 "acmmp", "quality",           "online"};
  return names;
}

namespace {

/// Photometric iterations on halved images first: windows see twice as far there, which low-textured surfaces need.
void StartAtHalfSize(int iterations, int full_size_iterations, PipelineOptions* options) {
  options->start_level = 1;
  options->patch_match.photometric_iterations = iterations;
  options->full_size_iterations = full_size_iterations;
}

/// What the papers do: candidates from all regions, every pixel in every iteration.
void CompareEverything(PatchMatchOptions* options) {
  options->alternate_regions = false;
  options->settled_views = 0;
}

/// `acmp` with more iterations, and with completion that asks the images what it may hide. Completions between the
/// passes, which were here, give better depth maps and less accurate clouds (docs/quality.md).
PipelineOptions MakeQuality() {
  PipelineOptions options;
  options.patch_match.photometric_iterations = 5;
  options.patch_match.planar_prior_iterations = 5;
  options.completion.hide_nothing_evident = true;
  return options;
}

PipelineOptions MakeOnline() {
  PipelineOptions options;
  StartAtHalfSize(3, 1, &options);
  options.patch_match.planar_prior_iterations = 1;
  options.patch_match.geometric_iterations = 1;
  options.geometric_passes = 1;
  options.patch_match.candidate_view_votes = 1;
  options.patch_match.view_draws = 8;
  options.planar_prior.cell_size_px = 8;
  // With one pass agreement with the neighbours' maps counts more than in the paper, and is cut off earlier.
  options.patch_match.geometric_weight = 0.2f;
  options.patch_match.geometric_max_px = 3.0f;
  return options;
}

/// The paper's systems keep what matching gave. Clouds of that have their largest F1 from here on (docs/quality.md).
void LeaveIncomplete(PipelineOptions* options) {
  options->completion.enabled = false;
  options->fusion.min_point_confidence = 0.2f;
}

}  // namespace

PipelineOptions MakePreset(const std::string& name) {
  if (name == "quality") return MakeQuality();
  if (name == "online") return MakeOnline();
  PipelineOptions options;
  if (name == "acmh" || name == "acmm") {
    options.use_planar_prior = false;
    LeaveIncomplete(&options);
    options.patch_match.candidate_view_votes = 0;  // without the prior, fewer views lose 0.5 points below 2 cm
    CompareEverything(&options.patch_match);
  } else if (name == "acmp_no_geometric") {
    options.geometric_passes = 0;
    LeaveIncomplete(&options);
  } else if (name != "acmp" && name != "acmmp") {
    std::string known;
    for (const std::string& preset : PresetNames()) known += (known.empty() ? "" : ", ") + preset;
    throw InvalidInputError(Concat("preset = \"", name, "\": must be one of ", known));
  }
  if (name == "acmm" || name == "acmmp") StartAtHalfSize(3, 2, &options);
  return options;
}

}  // namespace acmp
