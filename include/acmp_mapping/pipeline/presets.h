#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/completion/completion_options.h"
#include "acmp_mapping/fusion/fusion_options.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Everything that decides a depth map, given the views.
struct PipelineOptions {
  PatchMatchOptions patch_match;
  PlanarPriorOptions planar_prior;
  CompletionOptions completion;
  FusionOptions fusion;
  double sharpening = 2.5;       ///< of the images, as they become frames: FrameOptions
  int start_level = 0;           ///< how often the images of the photometric pass are halved, 0..2
  int full_size_iterations = 0;  ///< after such a start: photometric iterations at full size, 0..20
  bool use_planar_prior = true;  ///< steps 10-20 of Algorithm 1
  int geometric_passes = 2;      ///< how often steps 21-30 run, 0..10
};
void Validate(const PipelineOptions& options);

/// "acmh", "acmp_no_geometric", "acmp", "acmm", "acmmp", "quality", "online".
const std::vector<std::string>& PresetNames();

/// The systems compared in the paper as option sets of one pipeline: acmh = photometric + geometric passes,
/// acmp_no_geometric = ACMP\G = photometric + planar prior, acmp = all of the paper, and completion. acmm and acmmp:
/// the same two after a start on halved images, as ACMM has coarser scales. Those without completion fuse from a lower
/// confidence on. quality: three geometric passes of one iteration, the best maps; online: all steps with fewer
/// iterations, half of the time or less. Throws InvalidInputError naming the known presets.
PipelineOptions MakePreset(const std::string& name);

}  // namespace acmp
