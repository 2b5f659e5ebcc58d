#include "colmap_model.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "scene_private.h"

namespace acmp {
namespace {

bool HasModel(const std::filesystem::path& folder, const char* extension) {
  std::error_code ignored;
  return std::filesystem::exists(folder / (std::string("cameras") + extension), ignored) &&
         std::filesystem::exists(folder / (std::string("images") + extension), ignored);
}

}  // namespace

void ColmapModelBuilder::AddCamera(const std::string& where, int64_t id, ColmapCamera camera) {
  if (!model_.cameras.emplace(id, std::move(camera)).second) {
    throw InvalidInputError(Concat(where, ": camera id ", id, " occurs twice"));
  }
}

void ColmapModelBuilder::AddPoint(const std::string& where, int64_t id, const Eigen::Vector3d& point_in_world) {
  if (!point_in_world.allFinite()) {
    throw InvalidInputError(Concat(where, ": point ", id, " at (", point_in_world.transpose(), "): must be finite"));
  }
  if (!point_index_.emplace(id, static_cast<int>(model_.landmarks_in_world.size())).second) {
    throw InvalidInputError(Concat(where, ": point id ", id, " occurs twice"));
  }
  model_.landmarks_in_world.push_back(point_in_world);
}

void ColmapModelBuilder::AddImage(const std::string& where, ColmapImage image, const std::vector<int64_t>& point_ids) {
  if (model_.cameras.count(image.camera_id) == 0) {
    throw InvalidInputError(Concat(where, ": image ", image.name, " names camera id ", image.camera_id,
                                   ", which the cameras file does not have"));
  }
  if (!name_of_image_.emplace(image.id, image.name).second) {
    throw InvalidInputError(Concat(where, ": image id ", image.id, " occurs twice"));
  }
  if (!image_of_name_.emplace(image.name, image.id).second) {
    throw InvalidInputError(Concat(where, ": image name ", image.name, " occurs twice"));
  }
  for (int64_t point_id : point_ids) {
    if (point_id == -1) continue;
    const auto found = point_index_.find(point_id);
    if (found == point_index_.end()) {
      throw InvalidInputError(Concat(where, ": image ", image.name, " names point id ", point_id,
                                     ", which the points3D file does not have"));
    }
    image.landmark_indices.push_back(found->second);
  }
  // A point can have several features in one image; it is one landmark all the same.
  auto& indices = image.landmark_indices;
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  model_.images.push_back(std::move(image));
}

ColmapModel ColmapModelBuilder::Finish(const std::filesystem::path& folder) {
  if (model_.images.empty()) throw InvalidInputError(Concat(folder.string(), ": the COLMAP model has no images"));
  std::sort(model_.images.begin(), model_.images.end(),
            [](const ColmapImage& a, const ColmapImage& b) { return a.id < b.id; });
  return std::move(model_);
}

std::optional<std::filesystem::path> FindColmapModel(const std::filesystem::path& root) {
  for (const auto& folder : {root, root / "sparse", root / "sparse" / "0"}) {
    if (HasModel(folder, ".bin") || HasModel(folder, ".txt")) return folder;
  }
  return std::nullopt;
}

ColmapModel ReadColmapModel(const std::filesystem::path& folder) {
  ColmapModelBuilder builder;
  if (HasModel(folder, ".bin")) {
    ReadColmapBinary(folder, &builder);
  } else {
    ReadColmapText(folder, &builder);
  }
  return builder.Finish(folder);
}

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
