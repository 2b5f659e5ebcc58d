#include <iostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "evaluate_depth.h"
#include "evaluate_inputs.h"
#include "evaluate_report.h"
#include "tool_main.h"

namespace acmp {
namespace {

struct Arguments {
  DepthEvaluationOptions depth;
  std::string subset, csv, json;
  bool quiet = false;
  std::string reconstruction, ground_truth_cloud;
  std::vector<double> thresholds = {0.02, 0.05};
  double voxel_size = 0.01;
};

CLI::App* AddDepthCommand(CLI::App* app, Arguments* a) {
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
          "index (000007.pfm, depth_7.png), or the output folder of the public ACMP program")
      ->required();
  command->add_option("--gt", a->depth.ground_truth, "Folder of the ground truth, in SCENE or anywhere")
      ->capture_default_str();
  command->add_option("--name", a->depth.name, "Only files whose name contains this regular expression");
  command->add_option("--scale", a->depth.scale, "Multiply the predictions by this")->capture_default_str();
  command->add_option("--max-depth", a->depth.max_depth, "Leave out ground truth beyond this depth (0: none)")
      ->capture_default_str();
  command->add_option("--gt-png-unit", a->depth.png_unit, "Counts per unit of ground-truth .png files")
      ->capture_default_str();
  command->add_option("--subset", a->subset, "Only these image indices, for example 0,3,7-12");
  command
      ->add_option(
          "--lowtex", a->depth.low_texture,
          "Repeat the mean over pixels whose 11x11 neighbourhood has a grey standard deviation below this (0: off)")
      ->capture_default_str();
  command->add_option("--mask", a->depth.masks,
                      "Repeat the mean over the white pixels of the pictures in this folder, in SCENE or anywhere");
  command->add_option("--csv", a->csv, "Write the figures per image to this file");
  command->add_option("--json", a->json, "Write all figures to this file");
  command->add_flag("--quiet", a->quiet, "Leave out the lines per image");
  return command;
}

CLI::App* AddCloudCommand(CLI::App* app, Arguments* a) {
  CLI::App* command = app->add_subcommand(
      "cloud",
      "A point cloud against a ground-truth cloud, as in the ETH3D multi-view benchmark: accuracy is the percentage of "
      "reconstructed points within a threshold of the ground truth, completeness the reverse, F1 their harmonic mean; "
      "percentages are taken per voxel and averaged, so that dense regions do not dominate.");
  command->add_option("RECONSTRUCTION", a->reconstruction, "PLY file")->required();
  command->add_option("GROUND_TRUTH", a->ground_truth_cloud, "PLY file in the same frame and unit")->required();
  command->add_option("--thresholds", a->thresholds, "Distances, separated by commas")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--voxel", a->voxel_size, "Size of the voxels")->capture_default_str();
  return command;
}

int EvaluateDepthMaps(Arguments* a) {
  if (!a->subset.empty()) a->depth.subset = ParseSubset(a->subset);
  const DepthEvaluation evaluation = EvaluateDepthFolder(a->depth);
  for (const std::string& note : evaluation.notes) std::cerr << "note: " << note << '\n';
  std::cout << DepthTable(evaluation, a->quiet) << std::flush;
  if (!a->csv.empty()) WriteFileAtomically(a->csv, DepthCsv(evaluation));
  if (!a->json.empty()) WriteFileAtomically(a->json, DepthJson(evaluation));
  return kExitDone;
}

int EvaluatePointCloud(const Arguments& a) {
  const PointCloud reconstruction = ReadPly(a.reconstruction);
  const PointCloud ground_truth = ReadPly(a.ground_truth_cloud);
  std::cout << reconstruction.size() << " reconstructed points, " << ground_truth.size() << " true points, voxels of "
            << a.voxel_size << '\n'
            << CloudTable(EvaluateCloud(reconstruction, ground_truth, a.thresholds, a.voxel_size)) << std::flush;
  return kExitDone;
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app("Measures depth maps and point clouds against ground truth.", "acmp_evaluate");
  app.require_subcommand(1);
  app.footer("Exit code: 0 done, 2 wrong use or input, 1 failed. Details: acmp_evaluate depth --help");
  acmp::Arguments arguments;
  const CLI::App* depth = acmp::AddDepthCommand(&app, &arguments);
  acmp::AddCloudCommand(&app, &arguments);
  return acmp::RunTool(app, argc, argv, [&] {
    return depth->parsed() ? acmp::EvaluateDepthMaps(&arguments) : acmp::EvaluatePointCloud(arguments);
  });
}
