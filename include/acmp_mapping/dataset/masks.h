#pragma once

#include <cstddef>
#include <filesystem>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// Finds the masks of a scene's images in a folder, named as COLMAP names them: that of images/a/b.jpg is
/// FOLDER/a/b.jpg.png. Returns how many images have one; the others count as a whole. Throws InvalidInputError where
/// the folder is missing or has a mask for no image.
size_t AddMasks(const std::filesystem::path& folder, Scene* scene);

/// Reads a PNG or JPEG picture: black = ignore, everything else = use. Throws InvalidInputError as ReadColorImage does.
Mask ReadMask(const std::filesystem::path& path);
/// The same of a mask that must have the size of its image.
Mask ReadMask(const std::filesystem::path& path, const ImageSize& of_image);

/// What of the undistorted image counts: neither what its mask ignores, nor what the lens did not see. Empty where all
/// does. Throws as ReadMask does.
Mask LoadMask(const SceneImage& image);

}  // namespace acmp
