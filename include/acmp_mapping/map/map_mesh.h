#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {

struct MapMeshOptions {
  double voxel_size = 0;                ///< unit of the poses, >= 0; 0: MeshVoxelSize
  size_t max_bytes = 0;                 ///< see DistanceVolumeOptions
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

/// Of the voxels of a map's mesh: the median distance of the keyframes' points, at least the map's voxels. In steps
/// of sqrt(2) of these, so that it seldom changes while the map grows.
/// @param spacings of each keyframe, in the world (PointSpacing); 0: it has no points
/// @param current is kept within three quarters of a step; 0: none
double MeshVoxelSize(std::vector<double> spacings, double map_voxel_size, double current = 0);

/// What a keyframe saw, for a mesh. Empty maps where it has no points.
/// @param spacing of its points in the world
SurfaceMaps SurfaceOf(const PlacedKeyframe& keyframe, double spacing);

}  // namespace acmp
