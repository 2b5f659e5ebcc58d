#pragma once

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {

/// A SurfaceView that owns its pixels.
struct SurfaceMaps {
  PosedCamera camera;
  DepthMap depth;
  NormalMap normal;
  ConfidenceMap confidence;
  ColorImage color;

  SurfaceView View() const { return {camera, depth, normal, confidence, color}; }
};

/// What a camera saw, from the points that are left of it: each is a small square on its plane, which covers its
/// surroundings in an image whose pixels are as large as the spacing at the median depth. Points more than 75 degrees
/// off the optical axis are left out. Empty maps where there are no points.
/// @param points_in_camera about `spacing` apart, with unit normals that face the camera
/// @param spacing unit of the points, > 0
SurfaceMaps SplatPoints(const PointCloud& points_in_camera, const RigidTransform& world_from_cam, double spacing);
/// The same in the pixels of a given camera, or larger ones where it has far more than points (SplatCamera).
SurfaceMaps SplatPoints(const PointCloud& points_in_camera, const PosedCamera& camera, double spacing);

/// The camera with no more pixels than points can fill, 640 x 480 at least: a few points may come with a camera of any
/// size.
PinholeCamera SplatCamera(const PinholeCamera& camera, size_t points);

/// How far apart a camera's points lie at the median depth: where its pixels cover more than the voxels that they were
/// thinned to, farther than these. 0 without points before the camera.
/// @param voxel_size unit of the points, > 0
double PointSpacing(const PointCloud& points_in_camera, double voxel_size);

}  // namespace acmp
