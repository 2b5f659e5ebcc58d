#include <filesystem>
#include <iostream>

#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"
#include "scene_files.h"
#include "tool_main.h"

namespace {

struct Arguments {
  std::filesystem::path folder;
  acmp::SyntheticSceneOptions scene;
  float spacing_m = 0.02f;
  bool overwrite = false;
};

void AddOptions(CLI::App* app, Arguments* a) {
  app->add_option("FOLDER", a->folder, "Made if need be")->required();
  app->add_option("--width", a->scene.width, "Pixels, 32 to 8192")->capture_default_str();
  app->add_option("--height", a->scene.height, "Pixels, 32 to 8192")->capture_default_str();
  app->add_option("--keyframes", a->scene.keyframes, "Images, 2 to 1000")->capture_default_str();
  app->add_option("--seed", a->scene.seed, "Textures, noise and sway of the hand")->capture_default_str();
  app->add_option("--noise", a->scene.imaging.read_noise_grey, "Sensor noise per colour channel, grey levels")
      ->capture_default_str();
  app->add_option("--spacing", a->spacing_m, "Distance between the points of surface.ply, metres")
      ->capture_default_str();
  app->add_flag("--overwrite", a->overwrite, "Write into a folder that is not empty");
}

int MakeScene(const Arguments& a) {
  namespace fs = std::filesystem;
  if (!a.overwrite && fs::exists(a.folder) && !(fs::is_directory(a.folder) && fs::is_empty(a.folder))) {
    throw acmp::InvalidInputError(acmp::Concat(a.folder.string(), ": exists and is not an empty folder (--overwrite)"));
  }
  const std::vector<acmp::SyntheticView> views = acmp::MakeSyntheticScene(a.scene);
  acmp::WriteSceneFiles(a.folder, views, a.spacing_m);
  std::cout << a.folder.string() << ": " << views.size() << " images of " << a.scene.width << " x " << a.scene.height
            << std::endl;
  return acmp::kExitDone;
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app(
      "Makes a test scene: a room with blank walls and floor and textured furniture, seen from a hand-held camera, "
      "with "
      "exact depth. The folder can be read by acmp_reconstruct, acmp_make_bag and acmp_evaluate: images/, cameras.txt, "
      "sparse/ (COLMAP), cams/ and pair.txt (MVSNet), depth/ and surface.ply (ground truth), low_texture/ (masks of "
      "the "
      "blank surfaces).",
      "acmp_make_scene");
  app.footer(
      "Example: acmp_make_scene room --width 640 --height 480\nExit code: 0 done, 2 wrong use or input, 1 failed.");
  Arguments arguments;
  AddOptions(&app, &arguments);
  return acmp::RunTool(app, argc, argv, [&] { return MakeScene(arguments); });
}
