#include "acmp_mapping/dataset/scene.h"

#include <charconv>
#include <set>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "colmap_model.h"
#include "scene_private.h"

namespace acmp {
namespace {

int ParseIndex(const std::string& part, const std::string& number, int count) {
  int index = 0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), index);
  if (error != std::errc() || end != number.data() + number.size() || index < 0 || index >= count) {
    throw InvalidInputError(
        Concat("image list: \"", part, "\": must be an index in [0, ", count - 1, "] or a range of them such as 0-9"));
  }
  return index;
}

}  // namespace

SceneFormat ParseSceneFormat(const std::string& name) {
  if (name == "auto") return SceneFormat::kAuto;
  if (name == "colmap") return SceneFormat::kColmap;
  if (name == "mvsnet") return SceneFormat::kMvsnet;
  throw InvalidInputError(Concat("scene format \"", name, "\": must be auto, colmap or mvsnet"));
}

std::vector<int> ParseImageIndices(const std::string& text, int count) {
  std::set<int> indices;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const size_t dash = part.find('-', 1);
    const int first = ParseIndex(part, part.substr(0, dash), count);
    const int last = dash == std::string::npos ? first : ParseIndex(part, part.substr(dash + 1), count);
    if (last < first) throw InvalidInputError(Concat("image list: \"", part, "\": the range ends before it begins"));
    for (int index = first; index <= last; ++index) indices.insert(index);
  }
  if (indices.empty()) throw InvalidInputError(Concat("image list: \"", text, "\": names no image"));
  return std::vector<int>(indices.begin(), indices.end());
}

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

std::vector<Eigen::Vector3d> LandmarksOf(const Scene& scene, const SceneImage& image) {
  std::vector<Eigen::Vector3d> landmarks;
  landmarks.reserve(image.landmark_indices.size());
  for (int landmark : image.landmark_indices) landmarks.push_back(scene.landmarks_in_world[landmark]);
  return landmarks;
}

ColorImage LoadImage(const Scene& scene, int index) {
  CheckRange("image index", index, 0, static_cast<int>(scene.images.size()) - 1);
  const SceneImage& image = scene.images[index];
  return ReadColorImage(image.path, {image.camera.width, image.camera.height});
}

Frame LoadFrame(const Scene& scene, int index, const FrameOptions& options) {
  ColorImage color = LoadImage(scene, index);
  const SceneImage& image = scene.images[index];
  if (image.distortion.model != LensDistortion::Model::kNone) {
    color = Undistort(color, image.camera, image.distortion);
  }
  return MakeFrame(index, 0.0, std::move(color), image.camera, image.cam_from_world, LandmarksOf(scene, image),
                   options);
}

}  // namespace acmp
