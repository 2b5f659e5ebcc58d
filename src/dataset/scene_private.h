#pragma once

#include "acmp_mapping/dataset/scene.h"

namespace acmp {

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder);

/// True when `root` has the parts that make it an MVSNet scene: cams/ and pair.txt.
bool LooksLikeMvsnet(const std::filesystem::path& root);
Scene ReadMvsnetScene(const std::filesystem::path& root, PixelCenters centers);

/// The image without its lens distortion, seen by the same pinhole camera; black where it shows nothing.
ColorImage Undistort(const ColorImage& image, const PinholeCamera& camera, const LensDistortion& distortion);

/// The mask of the undistorted image: it ignores what is made of a pixel that `mask` ignores, and what the lens did not
/// see. Empty where all is used.
/// @param mask of the stored image; empty: all of its pixels count
Mask UndistortMask(Mask mask, const PinholeCamera& camera, const LensDistortion& distortion);

}  // namespace acmp
