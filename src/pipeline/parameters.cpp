#include "acmp_mapping/pipeline/parameters.h"

namespace acmp {
namespace {

OptionTable<PipelineOptions> MakePipelineOptionTable() {
  OptionTable<PipelineOptions> table;
  table.Group("pipeline");
  table.Add(
      Flag("use_planar_prior", "Help surfaces without texture by planes through the pixels that match well")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.use_planar_prior; });
  table.Add(
      Number("geometric_passes", 0, 10, "",
             "Passes that make the maps of neighbouring images agree; 0: fastest and least accurate")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.geometric_passes; });
  table.Add(
      Flag("completion",
           "Give pixels that hardly any other image confirms the planes of confirmed surfaces around them, and mark as "
           "a "
           "guess what has no texture and would hide what has, above all walls in a sky")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.fill.enabled; });
  table.Add(
      Flag("weighted_median", "With completion: let the outlines of surfaces follow the colours of the image")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.fill.weighted_median; });
  table.Add(
      Number("min_confidence", 0, 1, "",
             "A pixel becomes a point when it is right with this probability; more: fewer and better points")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.fusion.min_confidence; });

  table.Group("pipeline, offline only");
  table.Add(
      Number("photometric_iterations", 1, 20, "",
             "Iterations of the first pass, which compares images alone; more: better and slower"),
      [](auto& o) -> auto& { return o.patch_match.photometric_iterations; });
  table.Add(
      Number("planar_prior_iterations", 1, 20, "", "Iterations of the pass that the planar prior assists"),
      [](auto& o) -> auto& { return o.patch_match.planar_prior_iterations; });
  table.Add(
      Number("geometric_iterations", 1, 20, "", "Iterations of each geometric pass"),
      [](auto& o) -> auto& { return o.patch_match.geometric_iterations; });
  table.Add(
      Flag("prior_depth_metric",
           "Depth from outside is in the unit of the poses and trusted as it is; else scale and shift are fitted"),
      [](auto& o) -> auto& { return o.prior_depth.metric; });
  return table;
}

}  // namespace

const OptionTable<PipelineOptions>& PipelineOptionTable() {
  static const OptionTable<PipelineOptions> table = MakePipelineOptionTable();
  return table;
}

}  // namespace acmp
