#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/occupancy_map.h"

namespace acmp {

void CheckCanMapOccupancy() {
  if (!CanMapOccupancy()) {
    throw InvalidInputError(
        "this build knows no occupancy, as it has no OctoMap: install liboctomap-dev and build again");
  }
}

std::unique_ptr<OccupancyMap> MakeOccupancyMap(const PlacedKeyframes& map, double resolution,
                                               const OccupancyLimits& limits) {
  CheckCanMapOccupancy();
  if (map.keyframes.empty() || !(map.voxel_size > 0))
    throw InvalidInputError("the map is empty: there is no occupancy");
  for (double size = resolution > 0 ? resolution : kOccupancyVoxels * map.voxel_size;; size *= 2) {
    auto occupancy = std::make_unique<OccupancyMap>(size, limits);
    if (occupancy->Insert(map.keyframes)) return occupancy;
  }
}

}  // namespace acmp
