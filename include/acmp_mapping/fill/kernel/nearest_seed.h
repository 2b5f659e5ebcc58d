#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

/// Step of cells in one of 16 directions round the compass.
ACMP_HOST_DEVICE inline void DirectionStep(int direction, int* dc, int* dr) {
  // One quadrant: (1,0), (2,1), (1,1), (1,2); the others by turns of 90 degrees.
  const int step = direction % 4;
  const int c = step == 1 ? 2 : 1, r = step == 0 ? 0 : (step == 3 ? 2 : 1);
  const int quadrant = direction / 4;
  *dc = quadrant == 0 ? c : quadrant == 1 ? -r : quadrant == 2 ? -c : r;
  *dr = quadrant == 0 ? r : quadrant == 1 ? c : quadrant == 2 ? -r : -c;
}

/// Fills one direction of one cell of `nearest`: the first seed, or a strong one that is not much farther away. Looks
/// at `kAtOnce` cells before it asks what they have: a GPU thread waits for all of them together.
template <int kAtOnce = 1>
ACMP_HOST_DEVICE inline void FindNearestSeed(const FillContext& context, int cell_col, int cell_row, int direction) {
  constexpr int kTimesAsFar = 8, kStepsMore = 2;
  const ImageView<SeedCell>& cells = context.fitted;
  int dc, dr;
  DirectionStep(direction, &dc, &dr);
  int found = -1, last_step = cells.width + cells.height;
  for (int first = 0; first <= last_step && cells.Contains(cell_col + first * dc, cell_row + first * dr);
       first += kAtOnce) {
    bool is_seed[kAtOnce], is_strong[kAtOnce];
    ACMP_UNROLL
    for (int i = 0; i < kAtOnce; ++i) {
      const int col = cell_col + (first + i) * dc, row = cell_row + (first + i) * dr;
      const bool is_inside = cells.Contains(col, row);
      is_seed[i] = is_inside && cells(col, row).views > 0;
      is_strong[i] = is_inside && cells(col, row).is_strong;
    }
    ACMP_UNROLL
    for (int i = 0; i < kAtOnce; ++i) {
      const int step = first + i;
      if (step > last_step || !is_seed[i] || (found >= 0 && !is_strong[i])) continue;
      found = (cell_row + step * dr) * cells.width + cell_col + step * dc;
      const bool is_final = is_strong[i] || context.strong_views == 0;
      last_step = is_final ? -1 : kTimesAsFar * step + kStepsMore;
    }
  }
  context.nearest(cell_col, cell_row).cell[direction] = found;
}

}  // namespace acmp
