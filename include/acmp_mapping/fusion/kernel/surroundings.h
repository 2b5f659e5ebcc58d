#pragma once

#include "acmp_mapping/fusion/kernel/fusion_context.h"

namespace acmp {

/// What a pixel of another colour counts for: less, as it is more likely of another surface. A pixel on a small thing
/// in front of a wall is compared with the rest of the thing then, and one of the wall that was given the thing's depth
/// with the wall.
/// @param distance of the colours, ColorDistance; half of the weight is left at 20
ACMP_HOST_DEVICE inline double ColorWeight(int distance) {
  constexpr double kSquaredHalf = 400;
  return kSquaredHalf / (kSquaredHalf + static_cast<double>(distance) * distance);
}

/// Calls function(col, row, weight) for the pixels around one of the reference that are inside the image: 24, in 8
/// directions at 4, 8 and 16 px. Their weight is ColorWeight, or 1 without colours.
template <class View, class Function>
ACMP_HOST_DEVICE inline void ForEachAround(const View& reference, int col, int row, const Function& function) {
  const bool has_color = !reference.color.empty();
  for (int step = 4; step <= 16; step *= 2) {
    const int diagonal = step * 3 / 4;  // nearly as far: 0.75 sqrt(2) = 1.06
    for (int place = 0; place < 9; ++place) {
      if (place == 4) continue;  // the pixel itself
      const int right = place % 3 - 1, down = place / 3 - 1;
      const int length = right == 0 || down == 0 ? step : diagonal;
      const int c = col + right * length, r = row + down * length;
      if (!reference.depth.Contains(c, r)) continue;
      function(c, r, has_color ? ColorWeight(ColorDistance(reference.Color(col, row), reference.Color(c, r))) : 1.0);
    }
  }
}

}  // namespace acmp
