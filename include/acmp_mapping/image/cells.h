#pragma once

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Square cells of `size` px along `pixels`, the last one cut off at the image's border.
ACMP_HOST_DEVICE inline int CellsOf(int pixels, int size) { return (pixels + size - 1) / size; }

/// The pixel in the middle of a cell, which stands for it.
ACMP_HOST_DEVICE inline int MiddleOfCell(int cell, int size, int pixels) {
  const int middle = cell * size + size / 2;
  return middle < pixels ? middle : pixels - 1;
}

}  // namespace acmp
