// acmp_make_bag: turns a dataset folder, or the built-in synthetic room, into a recorded bag.

#include <filesystem>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/bags/bag_recording.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "tool_main.h"

namespace {

constexpr float kSurfaceSpacing_m = 0.01f;  // of the true surface's points

struct MakeBagArguments {
  std::vector<std::string> paths;
  bool synthetic = false;
  std::string scene_name;
  std::string ground_truth;
  std::string images, masks;
  std::string format = "auto", pixel_centers = "integer";
  acmp::SyntheticSceneOptions scene;
  acmp::RecordingOptions recording;
};

/// CLI11 would print the positional arguments of both forms as one.
class UsageOfBothForms : public CLI::Formatter {
 public:
  std::string make_usage(const CLI::App*, std::string) const override {
    return "Usage: acmp_make_bag [OPTIONS] SCENE OUT.bag\n       acmp_make_bag [OPTIONS] --synthetic OUT.bag\n";
  }
};

void AddOptions(CLI::App& app, MakeBagArguments& arguments) {
  acmp::RecordingOptions& recording = arguments.recording;
  app.add_option("paths", arguments.paths, "SCENE OUT.bag, or only OUT.bag with --synthetic")
      ->required()
      ->expected(1, 2)
      ->type_name("[SCENE] OUT.bag");
  app.option_defaults()->always_capture_default();
  app.add_option("--rate", recording.rate_hz, "Images per second of bag time");

  const std::string ungrouped = app.option_defaults()->get_group();
  app.option_defaults()->group("From a dataset folder");
  app.add_option("--format", arguments.format, "Layout of SCENE: auto, colmap or mvsnet")->type_name("NAME");
  app.add_option("--pixel-centers", arguments.pixel_centers,
                 "Of mvsnet: where K has the centre of the first pixel: integer (0, 0) or half (0.5, 0.5)")
      ->type_name("NAME");
  app.add_option("--images", arguments.images, "Only these images, by index from 0: 0-9,12");
  app.add_option("--masks", arguments.masks,
                 "Folder of masks, IMAGE_NAME.png as in COLMAP, black = ignore: recorded as /slam/mask")
      ->type_name("DIR");
  app.add_option("--max-image-size", recording.max_image_size, "Shrink so that the longer side has at most so many px")
      ->default_str("");

  app.option_defaults()->group("From the synthetic room");
  CLI::Option* synthetic =
      app.add_flag("--synthetic", arguments.synthetic, "Render a room with known geometry instead of reading SCENE");
  app.add_option("--scene", arguments.scene_name, "room (unless given), hard or street: as acmp_make_scene has them")
      ->type_name("NAME");
  app.add_option("--width", arguments.scene.width, "px");
  app.add_option("--height", arguments.scene.height, "px");
  app.add_option("--keyframes", arguments.scene.keyframes, "Number of images");
  app.add_option("--seed", arguments.scene.seed, "Of sensor noise and textures");
  app.add_option("--stereo-baseline", arguments.scene.stereo_baseline_m,
                 "Also a second camera so many m to the right (0: none), on /camera_right/image_raw and camera_info");
  app.add_flag("--standing", arguments.scene.standing, "The camera stands for all of it");
  app.add_flag("--moving-object", arguments.scene.moving_object, "A box moves through the room");
  app.add_flag("--labels", arguments.recording.labels,
               "Also the class of each pixel (config/labels.yaml), on /slam/labels");
  app.add_option("--ground-truth", arguments.ground_truth,
                 "Also write the room as a dataset with true depth, normals and surface")
      ->type_name("DIR");
  for (CLI::Option* option : app.get_options()) {
    if (option->get_group() == synthetic->get_group() && option != synthetic) option->needs(synthetic);
    if (option->get_group() == "From a dataset folder") option->excludes(synthetic);
  }
  app.option_defaults()->group(ungrouped);
}

acmp::RecordingSummary MakeSyntheticBag(const MakeBagArguments& arguments) {
  if (arguments.paths.size() != 1) throw acmp::InvalidInputError("--synthetic takes no SCENE: give only OUT.bag");
  if (const std::filesystem::path truth = arguments.ground_truth;
      std::filesystem::exists(truth) && !(std::filesystem::is_directory(truth) && std::filesystem::is_empty(truth))) {
    throw acmp::InvalidInputError(
        acmp::Concat("--ground-truth ", truth.string(), ": exists and is not an empty folder"));
  }
  acmp::SyntheticSceneOptions options = arguments.scene;
  if (!arguments.scene_name.empty()) acmp::SelectSyntheticScene(arguments.scene_name, &options);
  const std::vector<acmp::SyntheticView> views = acmp::MakeSyntheticScene(options);
  if (!arguments.ground_truth.empty()) acmp::WriteSceneFiles(arguments.ground_truth, views, kSurfaceSpacing_m);
  return acmp::RecordSynthetic(views, arguments.recording, arguments.paths[0]);
}

acmp::RecordingSummary MakeSceneBag(const MakeBagArguments& arguments) {
  if (arguments.paths.size() != 2) throw acmp::InvalidInputError("give SCENE and OUT.bag");
  acmp::Scene scene = acmp::ReadScene(arguments.paths[0], acmp::ParseSceneFormat(arguments.format),
                                      acmp::ParsePixelCenters(arguments.pixel_centers));
  if (!arguments.masks.empty()) acmp::AddMasks(arguments.masks, &scene);
  for (const std::string& warning : scene.warnings) std::cerr << "warning: " << warning << '\n';
  const std::vector<int> indices = acmp::ParseImageIndices(arguments.images, static_cast<int>(scene.images.size()));
  return acmp::RecordScene(scene, indices, arguments.recording, arguments.paths[1]);
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app(
      "Turns a posed image set (COLMAP model or MVSNet folder), or a synthetic room, into a ROS bag with\n"
      "images, camera_info, poses (T_world_cam, optical axes), sparse points and tf. The same input gives\n"
      "the same bytes. Exit codes: 0 done, 2 wrong use or input, 1 failed.",
      "acmp_make_bag");
  MakeBagArguments arguments;
  app.formatter(std::make_shared<UsageOfBothForms>());
  AddOptions(app, arguments);
  return acmp::RunTool(app, argc, argv, [&arguments] {
    const acmp::RecordingSummary summary = arguments.synthetic ? MakeSyntheticBag(arguments) : MakeSceneBag(arguments);
    std::cout << "wrote " << arguments.paths.back() << ": " << summary.images << " images over " << summary.duration_s
              << " s, " << (arguments.masks.empty() ? "" : acmp::Concat(summary.masks, " masks, ")) << summary.landmarks
              << " landmark observations\n";
    return acmp::kExitDone;
  });
}
