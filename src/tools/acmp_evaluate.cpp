#include <iostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "tool_main.h"

namespace acmp {
namespace {

struct EvaluateArguments {
  DepthEvaluationOptions depth;
  CloudEvaluationOptions cloud;
  std::string subset, json;
  bool quiet = false;
};

constexpr const char* kGroundTruthGroup = "Ground-truth depth maps";

void AddGroundTruthOptions(CLI::App* command, GroundTruthOptions* truth) {
  const std::string ungrouped = command->option_defaults()->get_group();
  command->option_defaults()->group(kGroundTruthGroup);
  command->add_option("--gt", truth->folder, "Folder of the ground truth, in SCENE or anywhere");
  command->add_option("--max-depth", truth->max_depth, "Leave out ground truth beyond this depth (0: none)");
  command->add_option("--gt-png-unit", truth->png_unit, "Counts per unit of ground-truth .png files");
  command->option_defaults()->group(ungrouped);
}

CLI::App* AddDepthCommand(CLI::App* app, EvaluateArguments* a) {
  CLI::App* command = app->add_subcommand(
      "depth",
      "Depth maps against a scene's ground truth: percentage of ground-truth pixels with an absolute error below 2, 5 "
      "and "
      "10 cm and a relative error below 1, 2 and 5 %. A pixel without an estimate counts as wrong, an image without a "
      "file "
      "as entirely missing. dens: percentage with an estimate; med: their median absolute error. Maps of another size "
      "are looked up at the nearest pixel.");
  command->add_option("SCENE", a->depth.scene, "Folder with cameras.txt, images/ and depth/")->required();
  command
      ->add_option(
          "PREDICTIONS", a->depth.predictions,
          "Folder with one .pfm, .dmb or 16-bit .png (millimetres) per image, named by the image's name or its "
          "index (000007.pfm, 00000007.dmb)")
      ->required();
  command->option_defaults()->always_capture_default();
  AddGroundTruthOptions(command, &a->depth.truth);
  command->add_option("--scale", a->depth.scale, "Multiply the predictions by this");
  command->add_flag("--median-scale", a->depth.median_scale,
                    "Multiply each map by the median of true over predicted depth: for poses whose scale is unknown or "
                    "drifts");
  command->add_option("--subset", a->subset, "Only these image indices, for example 0,3,7-12");
  command->add_option(
      "--lowtex", a->depth.low_texture,
      "Repeat the mean over pixels whose 11x11 neighbourhood has a grey standard deviation below this (0: off)");
  command
      ->add_option("--mask", a->depth.masks,
                   "Repeat the mean over the white pixels of the pictures in this folder, in SCENE or anywhere")
      ->default_str("");
  command->add_option("--json", a->json, "Write all figures to this file");
  command->add_flag("--quiet", a->quiet, "Leave out the lines per image");
  return command;
}

CLI::App* AddCloudCommand(CLI::App* app, EvaluateArguments* a) {
  CLI::App* command = app->add_subcommand(
      "cloud",
      "A point cloud against ground truth, as in the ETH3D multi-view benchmark: accuracy is the percentage of "
      "reconstructed points within a threshold of the ground truth, completeness the reverse, F1 their harmonic mean; "
      "percentages are taken per voxel and averaged, so that dense regions do not dominate.\n"
      "The depth maps of a SCENE are taken to the world and merged: of the points in a voxel of half the size of "
      "--voxel the first one stays. A reconstructed point counts for accuracy only if at least one of the maps "
      "observes "
      "its place: it projects on a pixel of known depth z and has itself a depth of at most z + the largest threshold "
      "there. What is in front of or on an observed surface is judged, what is hidden behind all of them or outside of "
      "all maps is not.");
  command
      ->add_option("RECONSTRUCTION", a->cloud.reconstruction,
                   "PLY file; of a mesh (PLY with faces) points at most half of --voxel apart are taken")
      ->required();
  command
      ->add_option("GROUND_TRUTH", a->cloud.ground_truth,
                   "PLY file in the same frame and unit, or a SCENE: folder with cameras.txt (T_world_cam) and depth/")
      ->required();
  command->option_defaults()->always_capture_default();
  command->add_option("--thresholds", a->cloud.thresholds, "Distances, separated by commas")->delimiter(',');
  command->add_option("--voxel", a->cloud.voxel_size, "Size of the voxels");
  AddGroundTruthOptions(command, &a->cloud.truth);
  command->add_option("--json", a->json, "Write all figures to this file");
  return command;
}

int EvaluateDepthMaps(EvaluateArguments* a) {
  constexpr int kMaxImages = 1000000;  // file names have six digits
  if (!a->subset.empty()) {
    const std::vector<int> subset = ParseImageIndices(a->subset, kMaxImages);
    a->depth.subset = {subset.begin(), subset.end()};
  }
  const DepthEvaluation evaluation = EvaluateDepthFolder(a->depth);
  for (const std::string& note : evaluation.notes) std::cerr << "note: " << note << '\n';
  std::cout << DepthTable(evaluation, a->quiet) << std::flush;
  if (!a->json.empty()) WriteFileAtomically(a->json, DepthJson(evaluation));
  return Printed();
}

int EvaluatePointCloud(const CLI::App& command, const EvaluateArguments& a) {
  if (!std::filesystem::is_directory(a.cloud.ground_truth)) {
    const auto is_of_maps = [](const CLI::Option* option) { return option->get_group() == kGroundTruthGroup; };
    for (const CLI::Option* option : command.get_options(is_of_maps)) {
      if (option->count() == 0) continue;
      throw InvalidInputError(Concat(option->get_name(), " = ", option->results().front(),
                                     ": needs a folder as "
                                     "GROUND_TRUTH, not ",
                                     a.cloud.ground_truth.string()));
    }
  }
  const CloudEvaluation evaluation = EvaluateCloudFile(a.cloud);
  std::cout << CloudTable(evaluation) << std::flush;
  if (!a.json.empty()) WriteFileAtomically(a.json, CloudJson(evaluation));
  return Printed();
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app("Measures depth maps and point clouds against ground truth.", "acmp_evaluate");
  app.require_subcommand(1);
  app.footer("Exit code: 0 done, 2 wrong use or input, 1 failed. Details: acmp_evaluate depth --help");
  acmp::EvaluateArguments arguments;
  const CLI::App* depth = acmp::AddDepthCommand(&app, &arguments);
  const CLI::App* cloud = acmp::AddCloudCommand(&app, &arguments);
  return acmp::RunTool(app, argc, argv, [&] {
    return depth->parsed() ? acmp::EvaluateDepthMaps(&arguments) : acmp::EvaluatePointCloud(*cloud, arguments);
  });
}
