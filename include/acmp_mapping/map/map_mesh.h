#pragma once

#include <cstddef>
#include <functional>

#include "acmp_mapping/fusion/triangle_mesh.h"
#include "acmp_mapping/map/map_store.h"

namespace acmp {

struct MapMeshOptions {
  double voxel_size = 0;  ///< unit of the poses, >= 0; 0: that of the map, or the points' distance where it is larger
  size_t max_bytes = 0;   ///< see DistanceVolumeOptions
  std::function<void()> check = [] {};  ///< called before each keyframe; what it throws ends the work
};

struct MapMesh {
  TriangleMesh mesh;                                 ///< local coordinates, axes of the world
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
  size_t keyframes = 0;                              ///< that it is of
};

/// The surface of the map's keyframes at their poses. Of their points, which is what the map keeps, so
/// that mapping and messages are as without it. Takes time in proportion to the points; the map is not held up. Throws
/// InvalidInputError for an empty map and for more than max_bytes.
MapMesh MakeMapMesh(const MapStore& map, const MapMeshOptions& options);

}  // namespace acmp
