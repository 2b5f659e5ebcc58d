#include "acmp_mapping/pipeline/presets.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/sharpening.h"

namespace acmp {

void Validate(const PipelineOptions& options) {
  Validate(options.patch_match);
  Validate(options.planar_prior);
  Validate(options.completion);
  Validate(options.fusion);
  CheckRange("pipeline.sharpening", options.sharpening, 0.0, kMaxSharpening);
  CheckRange("pipeline.start_level", options.start_level, 0, 2);
  CheckRange("pipeline.full_size_iterations", options.full_size_iterations, 0, 20);
  CheckRange("pipeline.geometric_passes", options.geometric_passes, 0, 10);
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
  return completion;
}

namespace {

/// What the papers leave out: they keep what matching gave, of images as they are. The papers do not say how sparse the
/// credible correspondences are; as in the authors' program it is one per cell of 5 x 5 px.
PipelineOptions MakePapers(Method method) {
  PipelineOptions options;
  options.patch_match.method = method;
  options.sharpening = 0;
  options.completion.enabled = false;
  options.fusion.min_point_confidence = 0;
  return options;
}

PipelineOptions MakeAcmh() {
  PipelineOptions options = MakePapers(Method::kAcmh);
  options.use_planar_prior = false;
  // That paper's own weight and truncation of the geometric term; eq. 13 of the later one has others.
  options.patch_match.geometric_weight = 0.2f;
  options.patch_match.geometric_max_px = 3.0f;
  return options;
}

PipelineOptions MakeAcmpNoGeometric() {
  PipelineOptions options = MakePapers(Method::kAcmp);
  options.geometric_passes = 0;
  return options;
}

PipelineOptions MakeAcmp() { return MakePapers(Method::kAcmp); }

/// Photometric iterations on halved images first: windows see twice as far there, which low-textured surfaces need.
void StartAtHalfSize(int full_size_iterations, PipelineOptions* options) {
  options->start_level = 1;
  options->full_size_iterations = full_size_iterations;
}

PipelineOptions MakeAcmm() {
  PipelineOptions options;
  StartAtHalfSize(2, &options);
  options.use_planar_prior = false;
  options.completion.enabled = false;
  options.fusion.min_point_confidence = 0.2f;
  options.patch_match.candidate_view_votes = 0;
  options.patch_match.settled_views = 0;
  return options;
}

PipelineOptions MakeBalanced() { return {}; }

PipelineOptions MakeOnline() {
  PipelineOptions options;
  StartAtHalfSize(1, &options);
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

struct Preset {
  const char* name;
  PipelineOptions (*make)();
};

constexpr Preset kPresets[] = {
    {"acmh", MakeAcmh}, {"acmm", MakeAcmm},         {"acmp_no_geometric", MakeAcmpNoGeometric},
    {"acmp", MakeAcmp}, {"balanced", MakeBalanced}, {"online", MakeOnline}};

}  // namespace

const std::vector<std::string>& PresetNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Preset& preset : kPresets) all.emplace_back(preset.name);
    return all;
  }();
  return names;
}

PipelineOptions MakePreset(const std::string& name) {
  std::string known;
  for (const Preset& preset : kPresets) {
    if (name == preset.name) return preset.make();
    known += (known.empty() ? "" : ", ") + std::string(preset.name);
  }
  throw InvalidInputError(Concat("preset = \"", name, "\": must be one of ", known));
}

}  // namespace acmp
