#pragma once

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

inline const PinholeCamera kVgaCamera = {640, 480, 525.5, 520.25, 311.75, 244.5};

}  // namespace acmp
