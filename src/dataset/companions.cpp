#include "acmp_mapping/dataset/scene.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "scene_private.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

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

}  // namespace

size_t AddMasks(const fs::path& folder, Scene* scene) {
  const auto names = [](const SceneImage& image) { return std::vector<std::string>{image.name + ".png"}; };
  return AddCompanions(folder, "masks", "a mask has the image's name and .png", names, &SceneImage::mask, scene);
}

Mask ReadMask(const fs::path& path) { return ToMask(ReadColorImage(path)); }

Mask ReadMask(const fs::path& path, const ImageSize& of_image) { return ToMask(ReadColorImage(path, of_image)); }

Mask ReadMaskOf(const SceneImage& image) {
  return image.mask.empty() ? Mask() : ReadMask(image.mask, {FileCamera(image).width, FileCamera(image).height});
}

Mask LoadMask(const SceneImage& image) { return RectifierOf(image)->RectifyMask(ReadMaskOf(image)); }

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

}  // namespace acmp
