#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// A surface of triangles. Frame and unit are those of the mesh's owner.
struct TriangleMesh {
  PointCloud vertices;
  std::vector<std::array<uint32_t, 3>> triangles;  ///< indices of vertices, counterclockwise as seen from in front
};

}  // namespace acmp
