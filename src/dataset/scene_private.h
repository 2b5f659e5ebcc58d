#pragma once

#include <opencv2/core/mat.hpp>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder,
                      const std::filesystem::path& image_folder);

/// True when `root` has the parts that make it an MVSNet scene: cams/ and pair.txt.
bool LooksLikeMvsnet(const std::filesystem::path& root);
Scene ReadMvsnetScene(const std::filesystem::path& root, const std::filesystem::path& image_folder,
                      PixelCenters centers);

/// Takes the lens distortion out of images of the camera's size, which are then seen by the same pinhole camera.
class Undistortion {
 public:
  Undistortion(const PinholeCamera& camera, const LensDistortion& distortion);

  /// Black where the image shows nothing.
  ColorImage Of(ColorImage image) const;
  /// The mask of the undistorted image: it ignores what is made of a pixel that `mask` ignores, and what the lens did
  /// not see. Empty where all is used.
  /// @param mask of the stored image; empty: all of its pixels count
  Mask Of(Mask mask) const;
  /// Depth z of the undistorted image, at the camera's size: the nearest pixel's; 0 where the stored one shows nothing.
  /// @param depth of the stored image at any size; empty: gives an empty one
  DepthMap Of(DepthMap depth) const;

 private:
  cv::Mat map_x_, map_y_;  ///< where a pixel of the undistorted image lies in the stored one; empty without distortion
};

/// The mask as stored; empty: the image has none. Throws as ReadMask does.
Mask ReadMaskOf(const SceneImage& image);

}  // namespace acmp
