#pragma once

#include <tbb/parallel_for.h>

namespace acmp {

/// Calls function(col, row) for all pixels or cells, rows in parallel.
template <class Function>
void ForEachPixel(int width, int height, const Function& function) {
  tbb::parallel_for(0, height, [&](int row) {
    for (int col = 0; col < width; ++col) function(col, row);
  });
}

}  // namespace acmp
