#pragma once

#include <memory>
#include <string>

#include <opencv2/core/mat.hpp>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// What a camera_info says about the image as it is sent.
struct CameraCalibration {
  PinholeCamera camera;  ///< of the image as sent: binning and region of interest already applied
  LensDistortion distortion;
  std::string frame_id;
};
using CalibrationPtr = std::shared_ptr<const CameraCalibration>;

bool SameCalibration(const CameraCalibration& a, const CameraCalibration& b);

/// Removes a camera's lens distortion; the result has the same size and the same K.
class ImageRectifier {
 public:
  explicit ImageRectifier(const CameraCalibration& calibration);

  /// Throws InvalidInputError when the image (8-bit RGB) has not the calibration's size. The first image of this size
  /// makes the maps: a camera_info alone, whatever size it claims, takes no memory.
  ColorImage Rectify(const cv::Mat& rgb);

  /// The mask of the rectified image: it ignores what is made of a pixel that `mask` ignores, and what the lens did not
  /// see. Empty where everything is used. Throws as Rectify does. Once an image has been rectified.
  /// @param mask of the image as sent; empty: all of its pixels count
  Mask RectifyMask(const Mask& mask) const;

  /// Depth z of the rectified image, at its size: the nearest pixel's; 0 where there is none. Once an image has been
  /// rectified.
  /// @param depth of the image as sent, at any size; empty: gives an empty one
  DepthMap RectifyDepth(const DepthMap& depth) const;

 private:
  void CheckSize(int width, int height) const;
  void BuildMaps();

  CameraCalibration calibration_;
  cv::Mat map_x_, map_y_;  ///< fixed point; empty without distortion
  Mask rim_;               ///< ignores what the lens did not see; empty: it saw everything
};

}  // namespace acmp
