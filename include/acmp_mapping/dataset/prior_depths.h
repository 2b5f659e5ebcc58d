#pragma once

#include <cstddef>
#include <filesystem>

#include "acmp_mapping/dataset/scene.h"

namespace acmp {

/// Finds the depth maps from outside of a scene's images in a folder: that of images/a/b.jpg is FOLDER/a/b with .pfm,
/// .dmb or .png (16 bit, thousandths), or the whole name with one of these. Returns how many images have one. Throws
/// InvalidInputError where the folder is missing or has one for no image, and where an image has several.
size_t AddPriorDepths(const std::filesystem::path& folder, Scene* scene);

/// As stored; 0: unknown. Empty: the image has none. Throws as ReadDepth does.
DepthMap ReadPriorDepthOf(const SceneImage& image);

}  // namespace acmp
