#include "acmp_mapping/common/error.h"
#include "colmap_model.h"
#include "scene_private.h"

namespace acmp {

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder) {
  ColmapModel model = ReadColmapModel(model_folder);
  Scene scene;
  scene.root = root;
  scene.landmarks_in_world = std::move(model.landmarks_in_world);
  for (ColmapImage& colmap_image : model.images) {
    SceneImage image;
    image.path = root / "images" / colmap_image.name;
    if (!std::filesystem::is_regular_file(image.path)) {
      throw InvalidInputError(Concat("image ", image.path.string(), " of the COLMAP model in ", model_folder.string(),
                                     " (image id ", colmap_image.id, ") is missing"));
    }
    const ColmapCamera& camera = model.cameras.at(colmap_image.camera_id);
    image.name = std::move(colmap_image.name);
    image.camera = camera.camera;
    image.distortion = camera.distortion;
    image.cam_from_world = colmap_image.cam_from_world;
    image.landmark_indices = std::move(colmap_image.landmark_indices);
    scene.images.push_back(std::move(image));
  }
  return scene;
}

}  // namespace acmp
