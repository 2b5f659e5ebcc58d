#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Index of the pixel of an image halved `level` times that covers pixel `index`; an odd last column or row belongs to
/// the one before. Planes are the camera's and do not change with the image's size.
ACMP_HOST_DEVICE inline int CoveringPixel(int index, int level, int halved_size) {
  const int covering = index >> level;
  return covering < halved_size ? covering : halved_size - 1;
}

}  // namespace acmp
