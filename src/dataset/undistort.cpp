#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <utility>

#include "acmp_mapping/image/image_processing.h"
#include "scene_private.h"

namespace acmp {

Undistortion::Undistortion(const PinholeCamera& camera, const LensDistortion& distortion) {
  if (distortion.model == LensDistortion::Model::kNone) return;
  const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const cv::Size size(camera.width, camera.height);
  if (distortion.model == LensDistortion::Model::kEquidistant) {
    cv::fisheye::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, map_x_,
                                         map_y_);
  } else {
    cv::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, map_x_, map_y_);
  }
}

ColorImage Undistortion::Of(ColorImage image) const {
  if (map_x_.empty()) return image;
  ColorImage result(map_x_.cols, map_x_.rows);
  cv::Mat target = AsMat(result);
  cv::remap(AsMat(image), target, map_x_, map_y_, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  return result;
}

Mask Undistortion::Of(Mask mask) const {
  if (map_x_.empty()) return mask;
  if (mask.empty()) mask = Mask(map_x_.cols, map_x_.rows, 255);
  Mask result = RemapMask(mask, map_x_, map_y_);
  return IgnoresSome(result) ? std::move(result) : Mask();
}

DepthMap Undistortion::Of(DepthMap depth) const {
  if (map_x_.empty() || depth.empty()) return depth;
  return RemapDepth(ResizeDepth(depth, map_x_.cols, map_x_.rows), map_x_, map_y_);
}

}  // namespace acmp
