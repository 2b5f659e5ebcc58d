// In place of occupancy_map.cpp in a build without OctoMap.

#include "acmp_mapping/map/occupancy_map.h"

#include <utility>

namespace acmp {

struct OccupancyMap::Tree {};
struct OccupancyMap::Rays {};

bool CanMapOccupancy() { return false; }

OccupancyMap::OccupancyMap(double resolution, OccupancyLimits limits)
    : resolution_(resolution), limits_(std::move(limits)) {
  CheckCanMapOccupancy();
}
OccupancyMap::~OccupancyMap() = default;
bool OccupancyMap::Insert(const std::vector<PlacedKeyframe>& /*keyframes*/) { return false; }
Occupancy OccupancyMap::At(const Eigen::Vector3d& /*point_in_world*/) const { return Occupancy::kUnknown; }
OccupancySlice OccupancyMap::Slice(double /*min_height*/, double /*max_height*/) const { return {}; }
void OccupancyMap::Write(const std::filesystem::path& /*path*/) const {}
size_t OccupancyMap::nodes() const { return 0; }

}  // namespace acmp
