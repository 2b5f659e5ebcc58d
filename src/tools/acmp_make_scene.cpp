#include <filesystem>
#include <iostream>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "tool_main.h"

namespace {

struct MakeSceneArguments {
  std::filesystem::path folder;
  std::string name = "room";
  std::optional<double> noise_grey;
  acmp::SyntheticSceneOptions scene;
  float spacing_m = 0.02f;
  bool overwrite = false;
};

void AddOptions(CLI::App* app, MakeSceneArguments* a) {
  app->add_option("FOLDER", a->folder, "Made if need be")->required();
  app->add_option(
         "--scene", a->name,
         "room: textured furniture, a camera with little noise; hard: thin objects, equal tiles and more that is "
         "blank, with the noise, blur, vignetting and changing exposure of a hand-held camera; street: houses, trees "
         "and posts under a sky, driven along")
      ->type_name("NAME")
      ->capture_default_str();
  app->add_option("--width", a->scene.width, "Pixels, 32 to 8192")->capture_default_str();
  app->add_option("--height", a->scene.height, "Pixels, 32 to 8192")->capture_default_str();
  app->add_option("--keyframes", a->scene.keyframes, "Images, 2 to 1000")->capture_default_str();
  app->add_option("--seed", a->scene.seed, "Textures, noise and sway of the hand")->capture_default_str();
  app->add_option("--noise", a->noise_grey,
                  "Sensor noise in the dark per colour channel, grey levels (as the scene's camera has it)");
  app->add_option("--spacing", a->spacing_m, "Distance between the points of surface.ply, metres, 0.001 to 1")
      ->capture_default_str();
  app->add_flag("--moving-object", a->scene.moving_object,
                "Something textured moves along with the camera, which depth/ and surface.ply leave out; masks/ has a "
                "mask of it for each image");
  app->add_option("--field-of-view", a->scene.field_of_view,
                  "Degrees, 121 to 240, of a fisheye whose circle fills the image's shorter side: images/, a COLMAP "
                  "model (OPENCV_FISHEYE) and surface.ply are written, for acmp_reconstruct and acmp_make_bag");
  app->add_flag("--overwrite", a->overwrite, "Write into a folder that is not empty");
}

int MakeScene(const MakeSceneArguments& a) {
  namespace fs = std::filesystem;
  if (!a.overwrite && fs::exists(a.folder) && !(fs::is_directory(a.folder) && fs::is_empty(a.folder))) {
    throw acmp::InvalidInputError(acmp::Concat(a.folder.string(), ": exists and is not an empty folder (--overwrite)"));
  }
  acmp::CheckSurfaceSpacing(a.spacing_m);  // before minutes of rendering
  acmp::SyntheticSceneOptions scene = a.scene;
  acmp::SelectSyntheticScene(a.name, &scene);
  if (a.noise_grey) scene.imaging.read_noise_grey = *a.noise_grey;
  const std::vector<acmp::SyntheticView> views = acmp::MakeSyntheticScene(scene);
  acmp::WriteSceneFiles(a.folder, views, a.spacing_m);
  std::cout << a.folder.string() << ": " << views.size() << " images of " << scene.width << " x " << scene.height
            << std::endl;
  return acmp::kExitDone;
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app(
      "Makes a test scene: a room with blank walls and floor, seen from a hand-held camera, or another, with exact "
      "depth. The folder can be read by acmp_reconstruct, acmp_make_bag and acmp_evaluate: images/, cameras.txt, "
      "sparse/ (COLMAP), cams/ and pair.txt (MVSNet), depth/ and surface.ply (ground truth), low_texture/ (masks of "
      "the blank surfaces); with --moving-object masks/ for acmp_reconstruct --masks.",
      "acmp_make_scene");
  app.footer(
      "Example: acmp_make_scene room --width 640 --height 480\nExit code: 0 done, 2 wrong use or input, 1 failed.");
  MakeSceneArguments arguments;
  AddOptions(&app, &arguments);
  return acmp::RunTool(app, argc, argv, [&] { return MakeScene(arguments); });
}
