#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <utility>

#include "acmp_mapping/image/image_processing.h"
#include "scene_private.h"

namespace acmp {

namespace {

/// Where each pixel of the undistorted image lies in the stored one.
struct UndistortionMaps {
  UndistortionMaps(const PinholeCamera& camera, const LensDistortion& distortion) {
    const cv::Matx33d k(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
    const cv::Size size(camera.width, camera.height);
    if (distortion.model == LensDistortion::Model::kEquidistant) {
      cv::fisheye::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, x, y);
    } else {
      cv::initUndistortRectifyMap(k, distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1, x, y);
    }
  }

  cv::Mat x, y;
};

}  // namespace

ColorImage Undistort(const ColorImage& image, const PinholeCamera& camera, const LensDistortion& distortion) {
  if (distortion.model == LensDistortion::Model::kNone) return image.Clone();
  const UndistortionMaps maps(camera, distortion);
  // OpenCV takes non-const pixels for headers that are only read.
  const cv::Mat source(image.height(), image.width(), CV_8UC3, const_cast<Rgb*>(image.data()));
  ColorImage result(camera.width, camera.height);
  cv::Mat target = AsMat(result);
  cv::remap(source, target, maps.x, maps.y, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  return result;
}

Mask UndistortMask(Mask mask, const PinholeCamera& camera, const LensDistortion& distortion) {
  if (distortion.model == LensDistortion::Model::kNone) return mask;
  if (mask.empty()) mask = Mask(camera.width, camera.height, 255);
  const UndistortionMaps maps(camera, distortion);
  const cv::Mat source(mask.height(), mask.width(), CV_8U, mask.data());
  Mask result(camera.width, camera.height);
  cv::Mat target(result.height(), result.width(), CV_8U, result.data());
  cv::remap(source, target, maps.x, maps.y, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  // What is interpolated with a pixel that is ignored is less than 255.
  for (unsigned char& used : result) used = used == 255 ? 255 : 0;
  return IgnoresSome(result) ? std::move(result) : Mask();
}

}  // namespace acmp
