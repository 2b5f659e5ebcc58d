#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/label.h"

namespace acmp {

/// Fused surface point. Frame and unit are those of the cloud's owner.
struct SurfacePoint {
  Vec3f position;
  Vec3f normal;  ///< unit
  Rgb color;
  Label label = 0;
  float confidence = 0;  ///< 0..1
};
static_assert(sizeof(SurfacePoint) == 32, "the label is where padding would be");

using PointCloud = std::vector<SurfacePoint>;

/// A surface of triangles. Frame and unit are those of the mesh's owner.
struct TriangleMesh {
  PointCloud vertices;
  std::vector<std::array<uint32_t, 3>> triangles;  ///< indices of vertices, counterclockwise as seen from in front
};

}  // namespace acmp
