#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

/// A credible correspondence: pixel and depth.
struct SupportPoint {
  int col = 0, row = 0;
  float depth = 0;  ///< z; 0: none
};

/// The best pixel of cell (cell_col, cell_row) with a cost below max_cost and a depth within [depth_min, depth_max],
/// the first in row-major order among equals; depth 0 where there is none. NaN costs and depths fail the comparisons.
ACMP_HOST_DEVICE inline SupportPoint FindSupportPointOfCell(const ImageView<const float>& depth,
                                                            const ImageView<const float>& cost, float depth_min,
                                                            float depth_max, float max_cost, int cell_size,
                                                            int cell_col, int cell_row) {
  SupportPoint best;
  float best_cost = max_cost;
  const int col_end = (cell_col + 1) * cell_size < depth.width ? (cell_col + 1) * cell_size : depth.width;
  const int row_end = (cell_row + 1) * cell_size < depth.height ? (cell_row + 1) * cell_size : depth.height;
  for (int row = cell_row * cell_size; row < row_end; ++row) {
    for (int col = cell_col * cell_size; col < col_end; ++col) {
      const float z = depth(col, row);
      if (!(cost(col, row) < best_cost) || !(z >= depth_min && z <= depth_max)) continue;
      best_cost = cost(col, row);
      best = {col, row, z};
    }
  }
  return best;
}

}  // namespace acmp
