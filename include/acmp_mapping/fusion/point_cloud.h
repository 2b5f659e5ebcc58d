#pragma once

#include <vector>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Fused surface point. Frame and unit are those of the cloud's owner.
struct SurfacePoint {
  Vec3f position;
  Vec3f normal;  ///< unit
  Rgb color;
  float confidence = 0;  ///< 0..1
};

using PointCloud = std::vector<SurfacePoint>;

}  // namespace acmp
