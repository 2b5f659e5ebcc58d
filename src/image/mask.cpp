#include "acmp_mapping/image/mask.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Pixels of the original that make up one of the resized image along an axis, first and last.
struct Sources {
  int first, last;
};

/// @param shrinks whether Resize averages areas; else it interpolates
Sources SourcesOf(int index, int from, int to, bool shrinks) {
  const double scale = static_cast<double>(from) / to;
  if (shrinks) {
    constexpr double kRounding = 1e-6;  // of a border between pixels
    const int first = static_cast<int>(std::floor(index * scale + kRounding));
    const int last = static_cast<int>(std::ceil((index + 1) * scale - kRounding)) - 1;
    return {std::clamp(first, 0, from - 1), std::clamp(last, 0, from - 1)};
  }
  const double at = (index + 0.5) * scale - 0.5;
  return {std::clamp(static_cast<int>(std::floor(at)), 0, from - 1),
          std::clamp(static_cast<int>(std::ceil(at)), 0, from - 1)};
}

}  // namespace

bool IgnoresSome(const Mask& mask) { return std::find(mask.begin(), mask.end(), 0) != mask.end(); }

bool IgnoresAll(const Mask& mask) {
  return !mask.empty() && std::all_of(mask.begin(), mask.end(), [](unsigned char used) { return used == 0; });
}

Mask ResizeMask(const Mask& mask, int width, int height) {
  if (mask.empty()) return {};
  const bool shrinks = width <= mask.width() && height <= mask.height();
  Mask resized(width, height);
  for (int row = 0; row < height; ++row) {
    const Sources rows = SourcesOf(row, mask.height(), height, shrinks);
    for (int col = 0; col < width; ++col) {
      const Sources cols = SourcesOf(col, mask.width(), width, shrinks);
      unsigned char least = 255;
      for (int r = rows.first; r <= rows.last; ++r) {
        for (int c = cols.first; c <= cols.last; ++c) least = std::min(least, mask(c, r));
      }
      resized(col, row) = least;
    }
  }
  return resized;
}

Mask HalveMask(const Mask& mask) {
  if (mask.empty()) return {};
  Mask halved(mask.width() / 2, mask.height() / 2, 255);
  for (int row = 0; row < mask.height(); ++row) {
    for (int col = 0; col < mask.width(); ++col) {
      unsigned char& covering = halved(std::min(col / 2, halved.width() - 1), std::min(row / 2, halved.height() - 1));
      covering = std::min(covering, mask(col, row));
    }
  }
  return halved;
}

Mask IntersectMasks(Mask a, const Mask& b) {
  if (a.empty()) return b.Clone();
  if (b.empty()) return a;
  if (a.width() != b.width() || a.height() != b.height()) {
    throw InvalidInputError(Concat("masks of one image: ", a.width(), " x ", a.height(), " px and ", b.width(), " x ",
                                   b.height(), ": must be of the same size"));
  }
  std::transform(a.begin(), a.end(), b.begin(), a.begin(),
                 [](unsigned char x, unsigned char y) { return std::min(x, y); });
  return a;
}

MaskDistanceMap MakeMaskDistance(const Mask& mask) {
  if (mask.empty()) return {};
  static_assert(kMaxMaskDistance == 255, "an unsigned char saturates there");
  // OpenCV takes non-const pixels for headers that are only read.
  const cv::Mat used(mask.height(), mask.width(), CV_8U, const_cast<unsigned char*>(mask.data()));
  cv::Mat distance;
  cv::distanceTransform(used, distance, cv::DIST_C, cv::DIST_MASK_3, CV_32F);
  MaskDistanceMap mask_distance(mask.width(), mask.height());
  distance.convertTo(cv::Mat(mask.height(), mask.width(), CV_8U, mask_distance.data()), CV_8U);
  return mask_distance;
}

}  // namespace acmp
