#include "acmp_mapping/dataset/masks.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "scene_private.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

Mask ToMask(const ColorImage& picture) {
  Mask mask(picture.width(), picture.height());
  std::transform(picture.begin(), picture.end(), mask.begin(),
                 [](const Rgb& c) { return static_cast<unsigned char>(c.r == 0 && c.g == 0 && c.b == 0 ? 0 : 255); });
  return mask;
}

}  // namespace

std::string ExampleIn(const fs::path& folder) {
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) return Concat("there is ", fs::relative(entry.path(), folder).string());
  }
  return "it is empty";
}

size_t AddMasks(const fs::path& folder, Scene* scene) {
  if (!fs::is_directory(folder)) {
    throw InvalidInputError(Concat("folder of masks ", folder.string(), ": does not exist or is not a folder"));
  }
  size_t found = 0;
  for (SceneImage& image : scene->images) {
    const fs::path path = folder / (image.name + ".png");
    if (!fs::is_regular_file(path)) continue;
    image.mask = path;
    ++found;
  }
  if (found == 0) {
    throw InvalidInputError(Concat("folder of masks ", folder.string(), ": has none for any of the ",
                                   scene->images.size(), " images; a mask has the image's name and .png, such as ",
                                   scene->images.empty() ? "" : scene->images.front().name, ".png; ",
                                   ExampleIn(folder)));
  }
  return found;
}

Mask ReadMask(const fs::path& path) { return ToMask(ReadColorImage(path)); }

Mask ReadMask(const fs::path& path, const ImageSize& of_image) { return ToMask(ReadColorImage(path, of_image)); }

Mask ReadMaskOf(const SceneImage& image) {
  return image.mask.empty() ? Mask() : ReadMask(image.mask, {image.camera.width, image.camera.height});
}

Mask LoadMask(const SceneImage& image) { return Undistortion(image.camera, image.distortion).Of(ReadMaskOf(image)); }

}  // namespace acmp
