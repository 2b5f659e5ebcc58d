#include "acmp_mapping/map/map_mesh.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {

MapMesh MakeMapMesh(const MapStore& map, const MapMeshOptions& options) {
  const PlacedKeyframes placed = map.Placed();
  if (placed.keyframes.empty() || !(placed.voxel_size > 0)) {
    throw InvalidInputError("the map is empty: there is no mesh");
  }
  std::vector<double> spacings;
  for (const PlacedKeyframe& keyframe : placed.keyframes) {
    spacings.push_back(keyframe.scale * PointSpacing(*keyframe.points_in_camera, placed.voxel_size));
  }
  const double voxel_size = std::max(Median(spacings), placed.voxel_size);
  DistanceVolume volume(
      {options.voxel_size > 0 ? options.voxel_size : voxel_size, options.max_bytes, kMinMeshConfidence});
  for (size_t i = 0; i < spacings.size(); ++i) {
    const PlacedKeyframe& keyframe = placed.keyframes[i];
    options.check();
    if (spacings[i] == 0) continue;
    const PointCloud& points = *keyframe.points_in_camera;
    const SurfaceMaps maps = keyframe.scale == 1
                                 ? SplatPoints(points, keyframe.world_from_cam, spacings[i])
                                 : SplatPoints(Scaled(points, keyframe.scale), keyframe.world_from_cam, spacings[i]);
    if (!maps.depth.empty()) volume.Integrate(maps.View());
  }
  return {volume.ExtractMesh(), placed.origin, placed.keyframes.size()};
}

}  // namespace acmp
