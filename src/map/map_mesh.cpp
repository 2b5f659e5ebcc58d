#include "acmp_mapping/map/map_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

PointCloud Scaled(const PointCloud& points, double scale) {
  PointCloud scaled = points;
  for (SurfacePoint& point : scaled) point.position = static_cast<float>(scale) * point.position;
  return scaled;
}

/// How far apart a keyframe's points lie at the median depth: where its pixels cover more than the map's voxels,
/// farther than these. 0 without points.
double SpacingOf(const PointCloud& points, double voxel_size) {
  constexpr double kHalfCovered = 0.7;  // of the box around them points cover half or more
  std::vector<float> depths;
  Eigen::AlignedBox2f box;
  for (const SurfacePoint& point : points) {
    const Vec3f& p = point.position;
    if (!(p.z > 0)) continue;
    depths.push_back(p.z);
    box.extend(Eigen::Vector2f(p.x / p.z, p.y / p.z));
  }
  if (depths.empty()) return 0;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return std::max(voxel_size, kHalfCovered * *middle * std::sqrt(box.volume() / static_cast<double>(depths.size())));
}

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

TriangleMesh MakeMapMesh(const MapStore& map, const MapMeshOptions& options, size_t* keyframes) {
  CheckCanMesh();
  const PlacedKeyframes placed = map.Placed();
  if (keyframes) *keyframes = placed.keyframes.size();
  if (placed.keyframes.empty() || !(placed.voxel_size > 0)) {
    throw InvalidInputError("the map is empty: there is no mesh");
  }
  std::vector<double> spacings;
  for (const PlacedKeyframe& keyframe : placed.keyframes) {
    spacings.push_back(keyframe.scale * SpacingOf(*keyframe.points_in_camera, placed.voxel_size));
  }
  const double voxel_size = std::max(Median(spacings), placed.voxel_size);
  DistanceVolume volume({options.voxel_size > 0 ? options.voxel_size : voxel_size, options.max_bytes, 0});
  for (size_t i = 0; i < spacings.size(); ++i) {
    const PlacedKeyframe& keyframe = placed.keyframes[i];
    if (spacings[i] == 0) continue;
    const PointCloud& points = *keyframe.points_in_camera;
    const SurfaceMaps maps = keyframe.scale == 1
                                 ? SplatPoints(points, keyframe.world_from_cam, spacings[i])
                                 : SplatPoints(Scaled(points, keyframe.scale), keyframe.world_from_cam, spacings[i]);
    if (!maps.depth.empty()) volume.Integrate(maps.View());
  }
  return volume.ExtractMesh();
}

}  // namespace acmp
