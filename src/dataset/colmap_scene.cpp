#include "acmp_mapping/common/error.h"
#include "colmap_model.h"
#include "scene_private.h"

namespace acmp {

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder,
                      const std::filesystem::path& image_folder) {
  ColmapModel model = ReadColmapModel(model_folder);
  Scene scene;
  scene.root = root;
  scene.landmarks_in_world = std::move(model.landmarks_in_world);
  size_t missing = 0;
  std::filesystem::path first_missing;
  for (ColmapImage& colmap_image : model.images) {
    SceneImage image;
    image.path = image_folder / colmap_image.name;
    if (!std::filesystem::is_regular_file(image.path)) {
      if (missing++ == 0) first_missing = image.path;
      continue;
    }
    const ColmapCamera& camera = model.cameras.at(colmap_image.camera_id);
    image.name = std::move(colmap_image.name);
    image.camera = camera.camera;
    image.distortion = camera.distortion;
    image.cam_from_world = colmap_image.cam_from_world;
    image.landmark_indices = std::move(colmap_image.landmark_indices);
    scene.images.push_back(std::move(image));
  }
  if (scene.images.empty()) {
    throw InvalidInputError(Concat("none of the ", missing, " images of the COLMAP model in ", model_folder.string(),
                                   " is in ", image_folder.string(), ", for example ", first_missing.string(),
                                   "; images of another folder: --image-path"));
  }
  if (missing > 0) {
    scene.warnings.push_back(Concat(missing, " of ", model.images.size(), " images of the COLMAP model in ",
                                    model_folder.string(), " are missing and left out, for example ",
                                    first_missing.string()));
  }
  return scene;
}

}  // namespace acmp
