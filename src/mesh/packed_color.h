#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// A mean colour in 32 bits: quarters of a grey level of red, green and blue, 10 bits each.
inline uint32_t PackColor(const Eigen::Vector3f& color) {
  const auto quarters = [](float value) { return static_cast<uint32_t>(std::lround(value * 4)); };
  return quarters(color.x()) << 20 | quarters(color.y()) << 10 | quarters(color.z());
}

inline Eigen::Vector3f UnpackColor(uint32_t packed) {
  const auto grey = [packed](int shift) { return static_cast<float>(packed >> shift & 1023u) / 4; };
  return {grey(20), grey(10), grey(0)};
}

inline Eigen::Vector3f ToVector(const Rgb& color) {
  return {static_cast<float>(color.r), static_cast<float>(color.g), static_cast<float>(color.b)};
}

/// @param color 0..255
inline Rgb ToRgb(const Eigen::Vector3f& color) {
  const auto byte = [](float value) { return static_cast<unsigned char>(std::lround(value)); };
  return {byte(color.x()), byte(color.y()), byte(color.z())};
}

}  // namespace acmp
