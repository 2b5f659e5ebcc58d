#include "acmp_mapping/dataset/scene.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <set>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/image/rectifier.h"
#include "scene_readers.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

int ParseIndex(const std::string& part, const std::string& number, int count) {
  int index = 0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), index);
  if (error != std::errc() || end != number.data() + number.size() || index < 0 || index >= count) {
    throw InvalidInputError(
        Concat("image list: \"", part, "\": must be an index in [0, ", count - 1, "] or a range of them such as 0-9"));
  }
  return index;
}

/// Cameras whose principal point is far from the image's middle were often made for images of another size. A cut-out
/// may have one as well: one warning for all.
void WarnOfPrincipalPoints(Scene* scene) {
  constexpr double kFarOff = 0.25;  // of the image's size
  const auto far_off = [](const SceneImage& image) {
    const PinholeCamera& c = image.camera;
    return std::abs((c.cx + 0.5) / c.width - 0.5) > kFarOff || std::abs((c.cy + 0.5) / c.height - 0.5) > kFarOff;
  };
  const auto first = std::find_if(scene->images.begin(), scene->images.end(), far_off);
  if (first == scene->images.end()) return;
  const PinholeCamera& c = first->camera;
  scene->warnings.push_back(Concat("the principal point of ", std::count_if(first, scene->images.end(), far_off),
                                   " of ", scene->images.size(), " images is far from their middle, for example of ",
                                   first->path.string(), ": cx = ", c.cx, ", cy = ", c.cy, " in ", c.width, " x ",
                                   c.height, " px; were the cameras made for images of another size, about ",
                                   std::lround(2 * c.cx + 1), " x ", std::lround(2 * c.cy + 1), " px?"));
}

Scene ReadSceneFiles(const std::filesystem::path& root, SceneFormat format, PixelCenters centers,
                     const std::filesystem::path& image_folder) {
  const bool mvsnet = LooksLikeMvsnet(root);
  if (format == SceneFormat::kMvsnet && !mvsnet) {
    throw InvalidInputError(Concat(root.string(), ": no MVSNet scene: cams/ or pair.txt is missing"));
  }
  const auto model_folder = FindColmapModel(root);
  if (mvsnet && format != SceneFormat::kColmap) {
    Scene scene = ReadMvsnetScene(root, image_folder, centers);
    if (format == SceneFormat::kAuto && model_folder) {
      scene.note = Concat(root.string(),
                          " has two layouts: cameras are those of MVSNet (cams/, pair.txt), not of the COLMAP "
                          "model in ",
                          model_folder->string(), " (--format colmap)");
    }
    return scene;
  }
  if (!model_folder) {
    throw InvalidInputError(Concat(
        root.string(), ": no COLMAP model (cameras and images as .bin or .txt in the folder, in ",
        "sparse/ or in sparse/0/)", format == SceneFormat::kAuto ? " and no MVSNet scene (cams/ and pair.txt)" : ""));
  }
  if (centers == PixelCenters::kHalf) {
    throw InvalidInputError(Concat(root.string(),
                                   ": pixel centres can be chosen for MVSNet scenes only; this is a COLMAP "
                                   "model, which has them at +0.5"));
  }
  return ReadColmapScene(root, *model_folder, image_folder);
}

/// Some file of the folder, for a message that says what is there.
std::string ExampleIn(const fs::path& folder) {
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) return Concat("there is ", fs::relative(entry.path(), folder).string());
  }
  return "it is empty";
}

/// Finds the file of each image in a folder, and returns how many have one.
/// @param kind of the files, for messages
/// @param rule how they are named, for messages
/// @param names_of(image) what its file may be called; the first is the example in messages
template <class NamesOf>
size_t AddCompanions(const fs::path& folder, const std::string& kind, const std::string& rule, const NamesOf& names_of,
                     fs::path SceneImage::*file, Scene* scene) {
  const std::string where = Concat("folder of ", kind, " ", folder.string());
  if (!fs::is_directory(folder)) throw InvalidInputError(where + ": does not exist or is not a folder");
  size_t count = 0;
  for (SceneImage& image : scene->images) {
    fs::path found;
    for (const std::string& name : names_of(image)) {
      const fs::path path = folder / name;
      if (!fs::is_regular_file(path)) continue;
      if (!found.empty()) {
        throw InvalidInputError(
            Concat("image ", image.name, " has two files of ", kind, ": ", found.string(), " and ", path.string()));
      }
      found = path;
    }
    if (found.empty()) continue;
    image.*file = found;
    ++count;
  }
  if (count == 0) {
    throw InvalidInputError(Concat(where, ": has none for any of the ", scene->images.size(), " images; ", rule,
                                   ", such as ", scene->images.empty() ? "" : names_of(scene->images.front()).front(),
                                   "; ", ExampleIn(folder)));
  }
  return count;
}

Mask ToMask(const ColorImage& picture) {
  Mask mask(picture.width(), picture.height());
  std::transform(picture.begin(), picture.end(), mask.begin(),
                 [](const Rgb& c) { return static_cast<unsigned char>(c.r == 0 && c.g == 0 && c.b == 0 ? 0 : 255); });
  return mask;
}

/// Of the file as stored.
const PinholeCamera& FileCamera(const SceneImage& image) { return image.face ? image.face->file_camera : image.camera; }

/// Of the maps of a rectifier that has been used: two 16-bit places, a 16-bit fraction and what is seen.
size_t BytesOf(const Rectifier& rectifier) {
  const PinholeCamera& camera = rectifier.face().camera;
  return size_t{7} * static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
}

/// The mask as stored; empty: the image has none. Throws as ReadMask does.
Mask ReadMaskOf(const SceneImage& image) {
  return image.mask.empty() ? Mask() : ReadMask(image.mask, {FileCamera(image).width, FileCamera(image).height});
}

}  // namespace

SceneFormat ParseSceneFormat(const std::string& name) {
  if (name == "auto") return SceneFormat::kAuto;
  if (name == "colmap") return SceneFormat::kColmap;
  if (name == "mvsnet") return SceneFormat::kMvsnet;
  throw InvalidInputError(Concat("scene format \"", name, "\": must be auto, colmap or mvsnet"));
}

PixelCenters ParsePixelCenters(const std::string& name) {
  if (name == "integer") return PixelCenters::kInteger;
  if (name == "half") return PixelCenters::kHalf;
  throw InvalidInputError(Concat("pixel centres \"", name, "\": must be integer or half"));
}

std::vector<int> ParseImageIndices(const std::string& text, int count) {
  std::set<int> indices;
  for (int index = 0; text.empty() && index < count; ++index) indices.insert(index);
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

Scene ReadScene(const std::filesystem::path& root, SceneFormat format, PixelCenters centers,
                const std::filesystem::path& image_folder) {
  if (!std::filesystem::is_directory(root)) {
    throw InvalidInputError(Concat("scene folder ", root.string(), " does not exist or is not a folder"));
  }
  Scene scene = ReadSceneFiles(root, format, centers, image_folder.empty() ? root / "images" : image_folder);
  WarnOfPrincipalPoints(&scene);
  return scene;
}

std::vector<Eigen::Vector3d> LandmarksOf(const Scene& scene, const SceneImage& image) {
  std::vector<Eigen::Vector3d> landmarks;
  landmarks.reserve(image.landmark_indices.size());
  for (int landmark : image.landmark_indices) landmarks.push_back(scene.landmarks_in_world[landmark]);
  return landmarks;
}

void SplitWideImages(Scene* scene) {
  std::vector<SceneImage> images;
  std::set<std::string> names;
  for (SceneImage& image : scene->images) {
    std::vector<PinholeFace> faces;
    if (image.distortion.model != LensDistortion::Model::kNone) {
      faces = FacesOf(Lens(image.camera, image.distortion, image.field_of_view));
    }
    const bool is_wide = faces.size() > 1;
    if (!is_wide) faces = {{"", image.camera}};
    for (const PinholeFace& face : faces) {
      SceneImage& part = images.emplace_back(image);
      if (is_wide) {
        const std::filesystem::path file(image.name);
        part.face = FaceOfImage{image.camera, face.lens_from_face};
        part.camera = face.camera;
        part.cam_from_world = RigidTransform(face.lens_from_face.transpose()) * image.cam_from_world;
        if (!face.name.empty()) {
          const std::string name = Concat(file.stem().string(), "_face_", face.name, file.extension().string());
          part.name = (file.parent_path() / name).string();
        }
      }
      if (!names.insert(part.name).second) {
        throw InvalidInputError(Concat("two images would have the name ", part.name, ", which is that of a face of ",
                                       "a wide image: rename the other file"));
      }
    }
  }
  scene->images = std::move(images);
}

std::pair<int, int> ImagesOfFile(const Scene& scene, int index) {
  const std::vector<SceneImage>& images = scene.images;
  const auto is_of_file = [&](size_t i) {
    return images[i].face && images[i].path == images[static_cast<size_t>(index)].path;
  };
  auto first = static_cast<size_t>(index), last = first + 1;
  while (images[first].face && first > 0 && is_of_file(first - 1)) --first;
  while (images[first].face && last < images.size() && is_of_file(last)) ++last;
  return {static_cast<int>(first), static_cast<int>(last)};
}

size_t AddMasks(const fs::path& folder, Scene* scene) {
  const auto names = [](const SceneImage& image) { return std::vector<std::string>{image.name + ".png"}; };
  return AddCompanions(folder, "masks", "a mask has the image's name and .png", names, &SceneImage::mask, scene);
}

Mask ReadMask(const fs::path& path) { return ToMask(ReadColorImage(path)); }

Mask ReadMask(const fs::path& path, const ImageSize& of_image) { return ToMask(ReadColorImage(path, of_image)); }

std::shared_ptr<const Rectifier> RectifierCache::Of(const SceneImage& image) {
  const Lens lens(FileCamera(image), image.distortion, image.field_of_view);
  const PinholeFace face = {"", image.camera, image.face ? image.face->lens_from_face : Eigen::Matrix3d::Identity()};
  if (!(image.readout == ReadoutMotion())) return std::make_shared<Rectifier>(lens, face, image.readout);
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& known : newest_) {
    if (known->lens() == lens && known->face() == face) return known;
  }
  newest_.push_back(std::make_shared<Rectifier>(lens, face, image.readout));
  while (newest_.size() > 1 && SumOfBytes() > max_bytes_) newest_.pop_front();
  return newest_.back();
}

size_t RectifierCache::bytes() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return SumOfBytes();
}

size_t RectifierCache::SumOfBytes() const {
  return std::accumulate(newest_.begin(), newest_.end(), size_t{0},
                         [](size_t sum, const auto& known) { return sum + BytesOf(*known); });
}

Mask LoadMask(const Scene& scene, const SceneImage& image) {
  return scene.rectifiers->Of(image)->RectifyMask(ReadMaskOf(image));
}

size_t AddPriorDepths(const fs::path& folder, Scene* scene) {
  const auto names = [](const SceneImage& image) {
    const std::string stem = fs::path(image.name).replace_extension().string();
    std::vector<std::string> all;
    for (const std::string& name : {stem, image.name}) {
      for (const char* extension : {".pfm", ".dmb", ".png"}) all.push_back(name + extension);
    }
    return all;
  };
  return AddCompanions(folder, "prior depth", "a map has the image's name and .pfm, .dmb or .png", names,
                       &SceneImage::prior_depth, scene);
}

DepthMap ReadPriorDepthOf(const SceneImage& image) {
  return image.prior_depth.empty() ? DepthMap() : ReadDepth(image.prior_depth);
}

ColorImage LoadImage(const Scene& scene, int index) {
  CheckRange("image index", index, 0, static_cast<int>(scene.images.size()) - 1);
  const SceneImage& image = scene.images[index];
  return ReadColorImage(image.path, {FileCamera(image).width, FileCamera(image).height});
}

Frame LoadFrame(const Scene& scene, int index, int max_size) {
  ColorImage color = LoadImage(scene, index);
  const SceneImage& image = scene.images[index];
  const auto rectifier = scene.rectifiers->Of(image);
  return MakeFrame(index, 0.0, rectifier->Rectify(std::move(color)), image.camera, image.cam_from_world,
                   LandmarksOf(scene, image), max_size, rectifier->RectifyMask(ReadMaskOf(image)),
                   rectifier->RectifyDepth(ReadPriorDepthOf(image)));
}

}  // namespace acmp
