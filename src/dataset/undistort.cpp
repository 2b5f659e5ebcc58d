#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "acmp_mapping/image/image_processing.h"
#include "scene_private.h"

namespace acmp {

ColorImage Undistort(const ColorImage& image, const PinholeCamera& camera, const LensDistortion& distortion) {
  if (distortion.model == LensDistortion::Model::kNone) return image.Clone();
  const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const cv::Size size(camera.width, camera.height);
  cv::Mat map_x;
  cv::Mat map_y;
  if (distortion.model == LensDistortion::Model::kEquidistant) {
    cv::fisheye::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, map_x,
                                         map_y);
  } else {
    cv::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, map_x, map_y);
  }
  // OpenCV takes non-const pixels for headers that are only read.
  const cv::Mat source(image.height(), image.width(), CV_8UC3, const_cast<Rgb*>(image.data()));
  ColorImage result(camera.width, camera.height);
  cv::Mat target = AsMat(result);
  cv::remap(source, target, map_x, map_y, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  return result;
}

}  // namespace acmp
