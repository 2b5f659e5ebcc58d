#include "acmp_mapping/dataset/scene.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "colmap_model.h"
#include "scene_private.h"

namespace acmp {

Scene ReadScene(const std::filesystem::path& root, SceneFormat format) {
  if (!std::filesystem::is_directory(root)) {
    throw InvalidInputError(Concat("scene folder ", root.string(), " does not exist or is not a folder"));
  }
  const bool mvsnet = LooksLikeMvsnet(root);
  if (format == SceneFormat::kMvsnet && !mvsnet) {
    throw InvalidInputError(Concat(root.string(), ": no MVSNet scene: cams/ or pair.txt is missing"));
  }
  if (mvsnet && format != SceneFormat::kColmap) return ReadMvsnetScene(root);
  const auto model_folder = FindColmapModel(root);
  if (!model_folder) {
    throw InvalidInputError(Concat(
        root.string(), ": no COLMAP model (cameras and images as .bin or .txt in the folder, in ",
        "sparse/ or in sparse/0/)", format == SceneFormat::kAuto ? " and no MVSNet scene (cams/ and pair.txt)" : ""));
  }
  return ReadColmapScene(root, *model_folder);
}

Frame LoadFrame(const Scene& scene, int index, int max_size) {
  CheckRange("image index", index, 0, static_cast<int>(scene.images.size()) - 1);
  const SceneImage& image = scene.images[index];
  ColorImage color = ReadColorImage(image.path);
  if (color.width() != image.camera.width || color.height() != image.camera.height) {
    throw InvalidInputError(Concat(image.path.string(), ": image size ", color.width(), " x ", color.height(),
                                   " differs from its camera's ", image.camera.width, " x ", image.camera.height));
  }
  if (image.distortion.model != LensDistortion::Model::kNone) {
    color = Undistort(color, image.camera, image.distortion);
  }
  std::vector<Eigen::Vector3d> landmarks;
  landmarks.reserve(image.landmark_indices.size());
  for (int landmark : image.landmark_indices) landmarks.push_back(scene.landmarks_in_world[landmark]);
  return MakeFrame(index, 0.0, std::move(color), image.camera, image.cam_from_world, std::move(landmarks), max_size);
}

}  // namespace acmp
