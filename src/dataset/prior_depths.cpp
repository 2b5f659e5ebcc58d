#include "acmp_mapping/dataset/prior_depths.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "scene_private.h"

namespace acmp {

namespace fs = std::filesystem;

size_t AddPriorDepths(const fs::path& folder, Scene* scene) {
  if (!fs::is_directory(folder)) {
    throw InvalidInputError(Concat("folder of prior depth ", folder.string(), ": does not exist or is not a folder"));
  }
  size_t found = 0;
  for (SceneImage& image : scene->images) {
    for (const fs::path& name : {fs::path(image.name).replace_extension(), fs::path(image.name)}) {
      for (const char* extension : {".pfm", ".dmb", ".png"}) {
        const fs::path path = folder / (name.string() + extension);
        if (!fs::is_regular_file(path)) continue;
        if (!image.prior_depth.empty()) {
          throw InvalidInputError(Concat("image ", image.name, " has two maps of prior depth: ",
                                         image.prior_depth.string(), " and ", path.string()));
        }
        image.prior_depth = path;
      }
    }
    if (!image.prior_depth.empty()) ++found;
  }
  if (found == 0) {
    throw InvalidInputError(
        Concat("folder of prior depth ", folder.string(), ": has none for any of the ", scene->images.size(),
               " images; a map has the image's name and .pfm, .dmb or .png, such as ",
               scene->images.empty() ? "" : fs::path(scene->images.front().name).replace_extension(".pfm").string(),
               "; ", ExampleIn(folder)));
  }
  return found;
}

DepthMap ReadPriorDepthOf(const SceneImage& image) {
  return image.prior_depth.empty() ? DepthMap() : ReadDepth(image.prior_depth);
}

}  // namespace acmp
