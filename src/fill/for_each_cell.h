#pragma once

#include <tbb/parallel_for.h>

#include "acmp_mapping/fill/kernel/nearest_seed.h"

namespace acmp {

/// Calls function(col, row) for all pixels or cells, rows in parallel.
template <class Function>
void ForEach(int width, int height, const Function& function) {
  tbb::parallel_for(0, height, [&](int row) {
    for (int col = 0; col < width; ++col) function(col, row);
  });
}

/// FindNearestSeed for all cells and directions.
inline void FindAllNearestSeeds(const FillContext& context) {
  ForEach(context.nearest.width, context.nearest.height, [&](int col, int row) {
    for (int direction = 0; direction < kNumDirections; ++direction) FindNearestSeed(context, col, row, direction);
  });
}

}  // namespace acmp
