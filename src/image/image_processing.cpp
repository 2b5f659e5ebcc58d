#include "acmp_mapping/image/image_processing.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace acmp {
namespace {

// OpenCV takes non-const pixels for headers that are only read.
cv::Mat ReadOnlyMat(const ColorImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8UC3, const_cast<Rgb*>(image.data()));
}

cv::Mat ReadOnlyMat(const GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_32FC1, const_cast<float*>(image.data()));
}

template <class T>
Image<T> ResizeAny(const Image<T>& image, int width, int height) {
  if (width == image.width() && height == image.height()) return image.Clone();
  Image<T> resized(width, height);
  cv::Mat target = AsMat(resized);
  const bool shrinks = width <= image.width() && height <= image.height();
  cv::resize(ReadOnlyMat(image), target, target.size(), 0, 0, shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
  return resized;
}

template <class T>
Image<T> ResizeNearest(const Image<T>& image, int width, int height) {
  Image<T> resized(width, height);
  for (int row = 0; row < height; ++row) {
    const auto from_row = static_cast<int>((2 * int64_t{row} + 1) * image.height() / (2 * int64_t{height}));
    for (int col = 0; col < width; ++col) {
      const auto from_col = static_cast<int>((2 * int64_t{col} + 1) * image.width() / (2 * int64_t{width}));
      resized(col, row) = image(from_col, from_row);
    }
  }
  return resized;
}

}  // namespace

cv::Mat AsMat(GrayImage& image) { return cv::Mat(image.height(), image.width(), CV_32FC1, image.data()); }
cv::Mat AsMat(ColorImage& image) { return cv::Mat(image.height(), image.width(), CV_8UC3, image.data()); }

GrayImage ToGray(const ColorImage& color) {
  // Converted in float: the 8-bit conversion would round away what flat areas have of texture. In strips that stay in
  // the cache: of the whole image that would be four times its bytes, asked of the system for each image anew.
  constexpr int kStripRows = 16;
  GrayImage gray(color.width(), color.height());
  const cv::Mat source = ReadOnlyMat(color);
  const cv::Mat target = AsMat(gray);
  const int strips = (color.height() + kStripRows - 1) / kStripRows;
  tbb::parallel_for(tbb::blocked_range<int>(0, strips), [&](const tbb::blocked_range<int>& range) {
    cv::Mat strip;
    for (int i = range.begin(); i < range.end(); ++i) {
      const cv::Range rows(i * kStripRows, std::min((i + 1) * kStripRows, color.height()));
      source.rowRange(rows).convertTo(strip, CV_32FC3);
      cv::Mat converted = target.rowRange(rows);
      cv::cvtColor(strip, converted, cv::COLOR_RGB2GRAY);
    }
  });
  return gray;
}

DepthMap ResizeDepth(const DepthMap& depth, int width, int height) {
  DepthMap resized = ResizeNearest(depth, width, height);
  for (float& z : resized) z = z > 0 && std::isfinite(z) ? z : 0;
  return resized;
}

LabelImage ResizeLabels(const LabelImage& labels, int width, int height) {
  return ResizeNearest(labels, width, height);
}

ColorImage Resize(const ColorImage& image, int width, int height) { return ResizeAny(image, width, height); }
GrayImage Resize(const GrayImage& image, int width, int height) { return ResizeAny(image, width, height); }

}  // namespace acmp
