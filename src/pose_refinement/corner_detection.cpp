#include "corner_detection.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

namespace acmp {
namespace {

/// What cv::cornerMinEigenVal gives where the gradients' root mean square along the weaker direction is `gradient`:
/// Sobel's 3 x 3 operator sums to eight times the gradient, is scaled by 1 / (4 block 255) and summed over block x
/// block px.
double ResponseOf(double gradient) { return 4 * gradient * gradient / (255.0 * 255.0); }

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

CornerOptions CornersFor(const PinholeCamera& camera, int corners) {
  CornerOptions options;
  const double pixels = static_cast<double>(camera.width) * camera.height;
  options.cell = std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / corners))));
  return options;
}

Image<float> CornerResponse(const Image<uint8_t>& image) {
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

std::vector<Eigen::Vector2d> PickCorners(const View& view, const Image<float>& response,
                                         const std::vector<Eigen::Vector2d>& taken, const CornerOptions& options) {
  const int cols = (response.width() + options.cell - 1) / options.cell;
  const int rows = (response.height() + options.cell - 1) / options.cell;
  std::vector<bool> is_taken(static_cast<size_t>(cols) * rows, false);
  for (const Eigen::Vector2d& pixel : taken) {
    const int col = static_cast<int>(pixel.x()) / options.cell, row = static_cast<int>(pixel.y()) / options.cell;
    if (col >= 0 && row >= 0 && col < cols && row < rows) is_taken[static_cast<size_t>(row) * cols + col] = true;
  }
  const auto threshold = static_cast<float>(ResponseOf(options.min_gradient));
  std::vector<Eigen::Vector2d> corners;
  for (int cell_row = 0; cell_row < rows; ++cell_row) {
    for (int cell_col = 0; cell_col < cols; ++cell_col) {
      if (is_taken[static_cast<size_t>(cell_row) * cols + cell_col]) continue;
      const int left = std::max(cell_col * options.cell, options.border);
      const int right = std::min((cell_col + 1) * options.cell, response.width() - options.border);
      const int top = std::max(cell_row * options.cell, options.border);
      const int bottom = std::min((cell_row + 1) * options.cell, response.height() - options.border);
      float best = threshold;
      int best_col = -1, best_row = -1;
      for (int row = top; row < bottom; ++row) {
        for (int col = left; col < right; ++col) {
          if (response(col, row) > best && IsLocalMaximum(response, col, row) &&
              view.IsClear({col, row}, options.border)) {
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
