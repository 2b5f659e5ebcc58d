#pragma once

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

inline const PinholeCamera kSmallCamera = {100, 80, 90, 90, 49.5, 39.5};

}  // namespace acmp
