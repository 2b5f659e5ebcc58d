#include "acmp_mapping/pipeline/presets.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

void Validate(const PipelineOptions& options) {
  PipelineOptions checked = options;
  OptionsOf(&checked).Check();
  if (options.multi_scale && (options.use_planar_prior || options.fill.enabled)) {
    throw InvalidInputError("pipeline.multi_scale = true: must go without use_planar_prior and completion");
  }
}

OptionList OptionsOf(PipelineOptions* o) {
  OptionList list;
  list.Group("pipeline");
  list.Flag("use_planar_prior", &o->use_planar_prior,
            "Help surfaces without texture by planes through the pixels that match well")
      .WhileRunning();
  list.Number("geometric_passes", &o->geometric_passes, 0, 10, "",
              "Passes that make the maps of neighbouring images agree; 0: fastest and least accurate")
      .WhileRunning();
  list.Flag("completion", &o->fill.enabled,
            "Give pixels that hardly any other image confirms the planes of confirmed surfaces around them, and make "
            "no points of what has no texture and would hide what has, above all walls in a sky")
      .WhileRunning();
  list.Flag("weighted_median", &o->fill.weighted_median,
            "With completion: let the outlines of surfaces follow the colours of the image")
      .WhileRunning();
  list.Number("min_confidence", &o->fusion.min_confidence, 0, 1, "",
              "A pixel becomes a point when it is right with this probability; more: fewer and better points")
      .WhileRunning();

  list.Group("pipeline, offline only");
  list.Number("photometric_iterations", &o->patch_match.photometric_iterations, 1, 20, "",
              "Iterations of the first pass, which compares images alone; more: better and slower");
  list.Number("planar_prior_iterations", &o->patch_match.planar_prior_iterations, 1, 20, "",
              "Iterations of the pass that the planar prior assists");
  list.Number("geometric_iterations", &o->patch_match.geometric_iterations, 1, 20, "",
              "Iterations of each geometric pass");
  list.Flag("prior_depth_metric", &o->prior_depth.metric,
            "Depth from outside is in the unit of the poses and trusted as it is; else scale and shift are fitted");
  return list;
}

namespace {

/// What the papers leave out: they keep what matching gave, of images as they are, and ask for closer depths. The
/// papers do not say how sparse the credible correspondences are; as in the authors' program it is one per cell of 5 x
/// 5 px.
PipelineOptions MakePapers(Method method) {
  PipelineOptions options;
  options.patch_match.method = method;
  options.patch_match.planar_prior_iterations = 3;
  options.patch_match.geometric_iterations = 2;
  options.fill.enabled = false;
  options.fusion.min_confidence = 0;
  options.fusion.min_consistent_views = 2;
  options.fusion.max_relative_depth = 0.01f;
  options.fusion.max_normal_angle_deg = 10;
  return options;
}

/// The paper's, which has no geometric consistency; the authors' program adds one geometric pass.
PipelineOptions MakeAcmh() {
  PipelineOptions options = MakePapers(Method::kAcmh);
  options.use_planar_prior = false;
  options.geometric_passes = 0;
  return options;
}

PipelineOptions MakeAcmp() {
  PipelineOptions options = MakePapers(Method::kAcmp);
  // Eq. 13 has another weight and truncation of the geometric term than ACMH.
  options.patch_match.geometric_weight = 0.1f;
  options.patch_match.geometric_max_px = 5.0f;
  return options;
}

PipelineOptions MakeAcmpNoGeometric() {
  PipelineOptions options = MakeAcmp();
  options.geometric_passes = 0;
  return options;
}

/// Three scales. Geometric consistency guides each, from the coarsest on, where windows see low-textured surfaces.
PipelineOptions MakeAcmm() {
  PipelineOptions options = MakeAcmh();
  options.geometric_passes = 2;
  options.multi_scale = true;
  options.start_level = 2;
  return options;
}

PipelineOptions MakeBalanced() { return {}; }

PipelineOptions MakeOnline() {
  PipelineOptions options;
  // Photometric iterations on halved images first: windows see twice as far there, as low-textured surfaces need.
  options.start_level = 1;
  options.full_size_iterations = 1;
  options.patch_match.planar_prior_iterations = 1;
  options.geometric_passes = 1;
  options.patch_match.view_draws = 8;
  options.planar_prior.cell_size_px = 10;
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

std::vector<KeyframeStep> ScheduleOf(const PipelineOptions& options) {
  using Kind = KeyframeStep::Kind;
  if (options.multi_scale) {
    std::vector<KeyframeStep> steps;
    for (int level = options.start_level; level >= 0; --level) {
      steps.push_back({level == options.start_level ? Kind::kInitial : Kind::kNextScale, 0, level});
      for (int pass = 0; pass < options.geometric_passes; ++pass) steps.push_back({Kind::kGeometricPass, pass, level});
    }
    return steps;
  }
  std::vector<KeyframeStep> steps = {{Kind::kInitial}};
  const bool fills = options.fill.enabled;
  if (fills && options.geometric_passes > 0) steps.push_back({Kind::kFillForPasses});
  for (int pass = 0; pass < options.geometric_passes; ++pass) steps.push_back({Kind::kGeometricPass, pass});
  if (fills) steps.push_back({Kind::kFillUnverified});
  return steps;
}

}  // namespace acmp
