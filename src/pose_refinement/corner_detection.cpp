#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/error.h"
#include "matching.h"

namespace acmp {
namespace {

/// What cv::cornerMinEigenVal gives where the gradients' root mean square along the weaker direction is `gradient`:
/// Sobel's 3 x 3 operator sums to eight times the gradient, is scaled by 1 / (4 block 255) and summed over block x
/// block px.
double ResponseOf(double gradient) { return 4 * gradient * gradient / (255.0 * 255.0); }

cv::Mat Wrap(Image<uint8_t>* image) { return {image->height(), image->width(), CV_8UC1, image->data()}; }

bool IsLocalMaximum(const Image<float>& response, int col, int row) {
  const float value = response(col, row);
  for (int r = row - 1; r <= row + 1; ++r) {
    for (int c = col - 1; c <= col + 1; ++c) {
      if (response(c, r) > value) return false;
    }
  }
  return true;
}

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

bool View::IsClear(const Eigen::Vector2d& pixel, double reach) const {
  if (mask_distance.empty()) return true;
  const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, mask_distance.width() - 1);
  const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, mask_distance.height() - 1);
  return mask_distance(col, row) > reach;
}

View MakeView(const std::string& name, const PinholeCamera& camera, const GrayImage& gray, const Mask& mask) {
  CheckSize(name + ": image", gray.width(), gray.height(), camera);
  return {camera, GrayPyramid(gray.View()), MakeMaskDistance(mask)};
}

Image<float> CornerResponse(const View& view) {
  const Image<uint8_t>& image = view.pyramid.level(0);
  const cv::Mat pixels(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.data()));
  Image<float> response(image.width(), image.height());
  cv::Mat result(image.height(), image.width(), CV_32FC1, response.data());
  constexpr int kBlock = 5, kGradient = 3;
  constexpr int kReach = kBlock / 2 + kGradient / 2;  // of a pixel's response
  constexpr int kRows = 64;                           // computed together; so high that the reach costs little
  tbb::parallel_for(0, (image.height() + kRows - 1) / kRows, [&](int strip) {
    const cv::Range rows(strip * kRows, std::min((strip + 1) * kRows, image.height()));
    const cv::Range seen(std::max(rows.start - kReach, 0), std::min(rows.end + kReach, image.height()));
    cv::Mat strip_response;
    cv::cornerMinEigenVal(pixels.rowRange(seen).clone(), strip_response, kBlock, kGradient);
    strip_response.rowRange(rows.start - seen.start, rows.end - seen.start).copyTo(result.rowRange(rows));
  });
  return response;
}

std::vector<Eigen::Vector2d> PickCorners(const View& view, const Image<float>& response, int corners_wanted,
                                         const std::vector<Eigen::Vector2d>& taken) {
  constexpr int kBorder = 10;           // px from the image's border and from what its mask ignores
  constexpr double kMinGradient = 1.5;  // grey values per px, root mean square along the weaker direction
  const double pixels = static_cast<double>(response.width()) * response.height();
  const int cell = std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / corners_wanted))));  // px
  const int cols = (response.width() + cell - 1) / cell, rows = (response.height() + cell - 1) / cell;
  std::vector<bool> is_taken(static_cast<size_t>(cols) * rows, false);
  for (const Eigen::Vector2d& pixel : taken) {
    const int col = static_cast<int>(pixel.x()) / cell, row = static_cast<int>(pixel.y()) / cell;
    if (col >= 0 && row >= 0 && col < cols && row < rows) is_taken[static_cast<size_t>(row) * cols + col] = true;
  }
  const auto threshold = static_cast<float>(ResponseOf(kMinGradient));
  std::vector<Eigen::Vector2d> corners;
  for (int cell_row = 0; cell_row < rows; ++cell_row) {
    for (int cell_col = 0; cell_col < cols; ++cell_col) {
      if (is_taken[static_cast<size_t>(cell_row) * cols + cell_col]) continue;
      const int left = std::max(cell_col * cell, kBorder);
      const int right = std::min((cell_col + 1) * cell, response.width() - kBorder);
      const int top = std::max(cell_row * cell, kBorder);
      const int bottom = std::min((cell_row + 1) * cell, response.height() - kBorder);
      float best = threshold;
      int best_col = -1, best_row = -1;
      for (int row = top; row < bottom; ++row) {
        for (int col = left; col < right; ++col) {
          if (response(col, row) > best && IsLocalMaximum(response, col, row) && view.IsClear({col, row}, kBorder)) {
            best = response(col, row), best_col = col, best_row = row;
          }
        }
      }
      if (best_col >= 0) corners.emplace_back(best_col, best_row);
    }
  }
  return corners;
}

}  // namespace acmp
