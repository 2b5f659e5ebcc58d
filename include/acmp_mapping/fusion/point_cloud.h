#pragma once

#include <array>
#include <cstdint>
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

/// A surface of triangles. Frame and unit are those of the mesh's owner.
struct TriangleMesh {
  PointCloud vertices;
  std::vector<std::array<uint32_t, 3>> triangles;  ///< indices of vertices, counterclockwise as seen from in front
};

}  // namespace acmp
