#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/fill/fill_options.h"
#include "acmp_mapping/fusion/fusion_options.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Everything that decides a depth map, given the views.
struct PipelineOptions {
  PatchMatchOptions patch_match;
  PlanarPriorOptions planar_prior;
  FillOptions fill;
  PriorDepthOptions prior_depth;
  FusionOptions fusion;
  int start_level = 0;           ///< how often the images of the photometric pass are halved, 0..2
  bool multi_scale = false;      ///< ACMM: all steps at each level from start_level on, without prior and filling
  int full_size_iterations = 0;  ///< after such a start: photometric iterations at full size, 0..20
  bool use_planar_prior = true;  ///< steps 10-20 of Algorithm 1
  int geometric_passes = 2;      ///< how often steps 21-30 run, 0..10
};
/// Throws InvalidInputError naming the first option that a user can set and that is out of bounds or does not go with
/// another.
void Validate(const PipelineOptions& options);

/// Options of the pipeline that a user can set, over those of the preset. A mapper has those that may change while it
/// runs as parameters; the offline tools take all of them.
OptionList OptionsOf(PipelineOptions* options);

/// "acmh", "acmm", "acmp_no_geometric", "acmp", "balanced", "online".
const std::vector<std::string>& PresetNames();

/// Option sets of one pipeline. The papers', which compute what these describe and nothing else:
///   acmh               photometric pass of ACMH; with geometric_passes = 1 what the authors' program runs
///   acmm               ACMM: photometric and geometric passes of ACMH at three scales
///   acmp_no_geometric  ACMP\G: steps 1-20 of Algorithm 1
///   acmp               all of Algorithm 1
/// Ours:
///   balanced           the default options
///   online             all steps with fewer iterations, half of the time or less
/// Throws InvalidInputError naming the known presets.
PipelineOptions MakePreset(const std::string& name);

/// One step of a keyframe's estimate. Whatever it reads of the source views' estimates is of the step before, as far as
/// those have come: all of them offline (Jacobi), what the window has online.
struct KeyframeStep {
  enum class Kind {
    kInitial,    ///< steps 1-20 of Algorithm 1: photometric pass, planar prior, planar-prior pass. Reads no estimates
    kNextScale,  ///< ACMM: photometric pass on images half as much reduced, which takes over what the step before
                 ///< knows better (detail restorer)
    kFillForPasses,   ///< planes from around for pixels that no source view confirms, for the passes to choose from
    kGeometricPass,   ///< steps 21-30 of Algorithm 1, once
    kFillUnverified,  ///< planes from around for what is unconfirmed after the passes, and the free-space check
  };
  Kind kind = Kind::kInitial;
  int pass = 0;   ///< of kGeometricPass: 0, 1, ... at its level
  int level = 0;  ///< how often the images of the estimate are halved
};

/// All steps of a keyframe in their order; the first one is kInitial. The offline tool, the online mapper and the
/// benchmark follow this list and nothing else decides what a keyframe goes through.
std::vector<KeyframeStep> ScheduleOf(const PipelineOptions& options);

}  // namespace acmp
