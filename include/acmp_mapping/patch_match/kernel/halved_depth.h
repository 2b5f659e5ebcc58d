#pragma once

#include <cstdint>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// The depths of a source view as geometric passes read them: an inverse depth per 2 x 2 px in 16 bits, half a byte per
/// pixel. Evenly spaced inverse depths are evenly spaced disparities, so the rounding moves a point by the same part of
/// a pixel at all depths: 1 / 131070 of the largest disparity. Depth maps at full size would be no better: a mean of
/// four has less noise, and within a surface it is interpolated (InverseAt).
struct HalvedDepth {
  ImageView<const uint16_t> inverse;  ///< in steps, 0 = unknown; empty: no map
  float step = 0;                     ///< 1 / scene unit: the greatest inverse depth of the map over kInverseSteps

  ACMP_HOST_DEVICE bool empty() const { return inverse.empty(); }
};

constexpr float kInverseSteps = 65535.0f;

/// Width or height of the halved map; an odd last row or column has a pixel of its own.
ACMP_HOST_DEVICE inline int HalvedSize(int size) { return (size + 1) / 2; }

/// 1 / z, or 0 where the depth is unknown or has no inverse in float.
ACMP_HOST_DEVICE inline float InverseOfDepth(float depth) {
  constexpr float kLargestInverse = 1e30f;
  const float inverse = depth > 0 ? 1.0f / depth : 0.0f;
  return inverse <= kLargestInverse ? inverse : 0.0f;
}

/// The inverse depth of pixel (col, row) of the halved map: the mean where the known ones of the four agree, else the
/// mean of the two that lie closest together, as a mean across a depth edge would lie on neither side; of only two the
/// nearer, which hides the other. 0: none is known.
ACMP_HOST_DEVICE inline float HalvedInverseDepth(const ImageView<const float>& depth, int col, int row) {
  constexpr float kAgreement = 0.02f;  // relative: a surface seen at 82 degrees from its normal with f = 500 px
  constexpr int kPixels = 4;
  float sorted[kPixels];
  int count = 0;
  for (int i = 0; i < kPixels; ++i) {
    const int c = 2 * col + i % 2, r = 2 * row + i / 2;
    if (!depth.Contains(c, r)) continue;
    const float inverse = InverseOfDepth(depth(c, r));
    if (!(inverse > 0)) continue;
    int slot = count++;
    for (; slot > 0 && inverse < sorted[slot - 1]; --slot) sorted[slot] = sorted[slot - 1];
    sorted[slot] = inverse;
  }
  if (count == 0) return 0;
  if (count == 1 || sorted[count - 1] - sorted[0] <= kAgreement * sorted[0]) {
    float sum = 0;
    for (int i = 0; i < count; ++i) sum += sorted[i];
    return sum / static_cast<float>(count);
  }
  if (count == 2) return sorted[1];
  int closest = 0;
  for (int i = 1; i + 1 < count; ++i) {
    if (sorted[i + 1] - sorted[i] < sorted[closest + 1] - sorted[closest]) closest = i;
  }
  return 0.5f * (sorted[closest] + sorted[closest + 1]);
}

/// An inverse depth in steps; only what is not known gives 0, so that the farthest points stay known.
ACMP_HOST_DEVICE inline uint16_t StepsOfInverse(float inverse, float step) {
  if (!(inverse > 0)) return 0;
  const float steps = inverse / step + 0.5f;
  return static_cast<uint16_t>(steps < 1 ? 1.0f : steps < kInverseSteps ? steps : kInverseSteps);
}

}  // namespace acmp
