#pragma once

#include <memory>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/image/rectifier.h"

namespace acmp {

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder,
                      const std::filesystem::path& image_folder);

/// True when `root` has the parts that make it an MVSNet scene: cams/ and pair.txt.
bool LooksLikeMvsnet(const std::filesystem::path& root);
Scene ReadMvsnetScene(const std::filesystem::path& root, const std::filesystem::path& image_folder,
                      PixelCenters centers);

/// Of the file as stored.
const PinholeCamera& FileCamera(const SceneImage& image);

/// Takes lens distortion and rolling shutter out of the image. Kept for the next images of the same camera, as its maps
/// take time.
std::shared_ptr<const Rectifier> RectifierOf(const SceneImage& image);

/// The mask as stored; empty: the image has none. Throws as ReadMask does.
Mask ReadMaskOf(const SceneImage& image);

}  // namespace acmp
