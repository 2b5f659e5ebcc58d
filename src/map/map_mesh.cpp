#include "acmp_mapping/map/map_mesh.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {

double MeshVoxelSize(std::vector<double> spacings, double map_voxel_size, double current) {
  spacings.erase(std::remove(spacings.begin(), spacings.end(), 0), spacings.end());
  if (spacings.empty()) return map_voxel_size;
  constexpr double kStepsPerDouble = 2, kKept = 0.75;  // steps
  const auto steps_of = [&](double size) { return std::max(0.0, kStepsPerDouble * std::log2(size / map_voxel_size)); };
  const double steps = steps_of(Median(std::move(spacings)));
  if (current > 0 && std::abs(steps - steps_of(current)) < kKept) return current;
  return map_voxel_size * std::exp2(std::round(steps) / kStepsPerDouble);
}

SurfaceMaps SurfaceOf(const PlacedKeyframe& keyframe, double spacing) {
  if (spacing == 0) return {};
  return SplatPoints(Scaled(keyframe.points_in_camera->Unpack(), keyframe.scale), keyframe.world_from_cam, spacing);
}

MapMesh MakeMapMesh(const MapStore& map, const MapMeshOptions& options) {
  const PlacedKeyframes placed = map.Placed();
  if (placed.keyframes.empty() || !(placed.voxel_size > 0)) {
    throw InvalidInputError("the map is empty: there is no mesh");
  }
  std::vector<double> spacings;
  for (const PlacedKeyframe& keyframe : placed.keyframes) {
    spacings.push_back(keyframe.scale * PointSpacing(keyframe.points_in_camera->Unpack(), placed.voxel_size));
  }
  const double voxel_size = options.voxel_size > 0 ? options.voxel_size : MeshVoxelSize(spacings, placed.voxel_size);
  DistanceVolume volume({voxel_size, options.max_bytes, kMinMeshConfidence});
  for (size_t i = 0; i < spacings.size(); ++i) {
    options.check();
    const SurfaceMaps maps = SurfaceOf(placed.keyframes[i], spacings[i]);
    if (!maps.depth.empty()) volume.Integrate(maps.View());
  }
  return {volume.ExtractMesh(), placed.origin, placed.keyframes.size()};
}

}  // namespace acmp
