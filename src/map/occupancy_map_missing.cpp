// In place of occupancy_map.cpp in a build without OctoMap.

#include "acmp_mapping/map/occupancy_map.h"

namespace acmp {

struct OccupancyMap::Tree {};

bool CanMapOccupancy() { return false; }

OccupancyMap::OccupancyMap(double resolution) : resolution_(resolution) { CheckCanMapOccupancy(); }
OccupancyMap::~OccupancyMap() = default;
void OccupancyMap::Insert(const PlacedKeyframe& /*keyframe*/) {}
Occupancy OccupancyMap::At(const Eigen::Vector3d& /*point_in_world*/) const { return Occupancy::kUnknown; }
OccupancySlice OccupancyMap::Slice(double /*min_height*/, double /*max_height*/) const { return {}; }
void OccupancyMap::Write(const std::filesystem::path& /*path*/) const {}
size_t OccupancyMap::nodes() const { return 0; }

}  // namespace acmp
