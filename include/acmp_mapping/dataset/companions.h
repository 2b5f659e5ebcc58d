#pragma once

#include <cstddef>
#include <filesystem>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/image/mask.h"

// Files beside the images of a scene, in folders of their own: masks, and depth maps from outside.
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

/// Finds the depth maps from outside of a scene's images in a folder: that of images/a/b.jpg is FOLDER/a/b with .pfm,
/// .dmb or .png (16 bit, thousandths), or the whole name with one of these. Returns how many images have one. Throws
/// InvalidInputError where the folder is missing or has one for no image, and where an image has several.
size_t AddPriorDepths(const std::filesystem::path& folder, Scene* scene);

/// As stored; 0: unknown. Empty: the image has none. Throws as ReadDepth does.
DepthMap ReadPriorDepthOf(const SceneImage& image);

}  // namespace acmp
