#pragma once

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Square cells of `size` px along `pixels`, the last one cut off at the image's border.
ACMP_HOST_DEVICE inline int CellsOf(int pixels, int size) { return (pixels + size - 1) / size; }

/// Size of the cells of which about so many lie along the longer side of an image, px, at least 1. What is done per
/// cell does not grow with the image.
ACMP_HOST_DEVICE inline int SizeOfCells(int width, int height, int cells_across) {
  const int longer = width > height ? width : height;
  const int size = (longer + cells_across / 2) / cells_across;
  return size > 1 ? size : 1;
}

/// The pixel in the middle of a cell, which stands for it.
ACMP_HOST_DEVICE inline int MiddleOfCell(int cell, int size, int pixels) {
  const int middle = cell * size + size / 2;
  return middle < pixels ? middle : pixels - 1;
}

}  // namespace acmp
