#include "gray_pyramid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace acmp {
namespace {

Image<uint8_t> Rounded(const ImageView<const float>& gray) {
  Image<uint8_t> result(gray.width, gray.height);
  tbb::parallel_for(0, gray.height, [&](int row) {
    for (int col = 0; col < gray.width; ++col) {
      result(col, row) = static_cast<uint8_t>(std::lrint(std::clamp(gray(col, row), 0.0f, 255.0f)));
    }
  });
  return result;
}

Image<uint8_t> Halved(const Image<uint8_t>& image) {
  Image<uint8_t> result(image.width() / 2, image.height() / 2);
  for (int row = 0; row < result.height(); ++row) {
    const uint8_t* upper = &image(0, 2 * row);
    const uint8_t* lower = &image(0, 2 * row + 1);
    for (int col = 0; col < result.width(); ++col) {
      const int sum = upper[2 * col] + upper[2 * col + 1] + lower[2 * col] + lower[2 * col + 1];
      result(col, row) = static_cast<uint8_t>((sum + 2) / 4);
    }
  }
  return result;
}

}  // namespace

GrayPyramid::GrayPyramid(const ImageView<const float>& gray) {
  constexpr int kSmallest = 32;
  levels_.push_back(Rounded(gray));
  while (levels() < kLevels && std::min(levels_.back().width(), levels_.back().height()) >= 2 * kSmallest) {
    levels_.push_back(Halved(levels_.back()));
  }
}

}  // namespace acmp
