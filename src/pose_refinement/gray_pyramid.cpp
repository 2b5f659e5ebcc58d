#include "gray_pyramid.h"

#include <algorithm>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

namespace acmp {
namespace {

cv::Mat Wrap(Image<uint8_t>* image) { return {image->height(), image->width(), CV_8UC1, image->data()}; }

}  // namespace

GrayPyramid::GrayPyramid(const ImageView<const float>& gray) {
  constexpr int kSmallest = 32;
  levels_.emplace_back(gray.width, gray.height);
  cv::Mat level = Wrap(&levels_.back());
  cv::Mat(gray.height, gray.width, CV_32FC1, const_cast<float*>(gray.data), gray.stride * sizeof(float))
      .convertTo(level, CV_8U);
  while (levels() < kLevels && std::min(level.cols, level.rows) >= 2 * kSmallest) {
    const cv::Mat even = level(cv::Rect(0, 0, level.cols / 2 * 2, level.rows / 2 * 2));
    levels_.emplace_back(level.cols / 2, level.rows / 2);
    cv::Mat half = Wrap(&levels_.back());
    cv::resize(even, half, half.size(), 0, 0, cv::INTER_AREA);
    level = half;
  }
}

}  // namespace acmp
