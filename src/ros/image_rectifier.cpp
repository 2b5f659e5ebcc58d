#include "acmp_mapping/ros/input_conversion.h"

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {

bool SameCalibration(const CameraCalibration& a, const CameraCalibration& b) {
  return a.camera == b.camera && a.distortion.model == b.distortion.model &&
         a.distortion.coefficients == b.distortion.coefficients && a.frame_id == b.frame_id;
}

ImageRectifier::ImageRectifier(const CameraCalibration& calibration) : calibration_(calibration) {}

void ImageRectifier::BuildMaps() {
  const PinholeCamera& c = calibration_.camera;
  const cv::Matx33d k(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
  const cv::Size size(c.width, c.height);
  cv::Mat x, y;
  if (calibration_.distortion.model == LensDistortion::Model::kEquidistant) {
    cv::fisheye::initUndistortRectifyMap(k, calibration_.distortion.coefficients, cv::Matx33d::eye(), k, size, CV_32FC1,
                                         x, y);
  } else {
    cv::initUndistortRectifyMap(k, calibration_.distortion.coefficients, cv::noArray(), k, size, CV_32FC1, x, y);
  }
  const cv::Mat seen = (x >= 0) & (y >= 0) & (x <= c.width - 1) & (y <= c.height - 1);
  if (cv::countNonZero(seen) < c.width * c.height) {
    rim_ = Mask(c.width, c.height);
    seen.copyTo(cv::Mat(c.height, c.width, CV_8U, rim_.data()));
  }
  cv::convertMaps(x, y, map_x_, map_y_, CV_16SC2);
}

void ImageRectifier::CheckSize(int width, int height) const {
  const PinholeCamera& c = calibration_.camera;
  if (width == c.width && height == c.height) return;
  throw InvalidInputError(Concat("image size ", width, "x", height, ": camera_info says ", c.width, "x", c.height));
}

ColorImage ImageRectifier::Rectify(const cv::Mat& rgb) {
  const PinholeCamera& c = calibration_.camera;
  CheckSize(rgb.cols, rgb.rows);
  if (map_x_.empty() && calibration_.distortion.model != LensDistortion::Model::kNone) BuildMaps();
  ColorImage rectified(c.width, c.height);
  cv::Mat target(c.height, c.width, CV_8UC3, rectified.data());
  if (map_x_.empty()) {
    rgb.copyTo(target);
  } else {
    cv::remap(rgb, target, map_x_, map_y_, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  }
  return rectified;
}

Mask ImageRectifier::RectifyMask(const Mask& mask) const {
  if (mask.empty()) return rim_.Clone();
  CheckSize(mask.width(), mask.height());
  if (map_x_.empty()) return IntersectMasks(mask.Clone(), rim_);
  return IntersectMasks(RemapMask(mask, map_x_, map_y_), rim_);
}

DepthMap ImageRectifier::RectifyDepth(const DepthMap& depth) const {
  if (depth.empty()) return {};
  const PinholeCamera& c = calibration_.camera;
  DepthMap sent = ResizeDepth(depth, c.width, c.height);
  return map_x_.empty() ? std::move(sent) : RemapDepth(std::move(sent), map_x_, map_y_);
}

}  // namespace acmp
