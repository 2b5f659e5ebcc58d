#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Grey images of 8 bits, each half as large as the one before: pixel u of level l lies at (u + 0.5) 2^l - 0.5 of
/// level 0.
class GrayPyramid {
 public:
  static constexpr int kLevels = 4;

  GrayPyramid() = default;
  /// Grey values are rounded to whole numbers of 0..255. Levels smaller than 32 px are left out.
  explicit GrayPyramid(const ImageView<const float>& gray);

  int levels() const { return static_cast<int>(levels_.size()); }
  const Image<uint8_t>& level(int l) const { return levels_[static_cast<size_t>(l)]; }

 private:
  std::vector<Image<uint8_t>> levels_;
};

/// A pixel of level 0 in level l, and back.
inline double ToLevel(double u, int l) { return (u + 0.5) / (1 << l) - 0.5; }
inline double FromLevel(double u, int l) { return (u + 0.5) * (1 << l) - 0.5; }

/// Bilinear; the caller makes sure that 0 <= col < width - 1 and 0 <= row < height - 1.
inline float Sample(const Image<uint8_t>& image, float col, float row) {
  const int c = static_cast<int>(col), r = static_cast<int>(row);
  const float a = col - static_cast<float>(c), b = row - static_cast<float>(r);
  const uint8_t* p = image.data() + static_cast<size_t>(r) * image.width() + c;
  const uint8_t* q = p + image.width();
  const auto upper = static_cast<float>(p[0]) + a * static_cast<float>(p[1] - p[0]);
  const auto lower = static_cast<float>(q[0]) + a * static_cast<float>(q[1] - q[0]);
  return upper + b * (lower - upper);
}

}  // namespace acmp
