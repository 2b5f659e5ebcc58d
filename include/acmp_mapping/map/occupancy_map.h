#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "acmp_mapping/map/map_store.h"

namespace acmp {

enum class Occupancy { kUnknown, kFree, kOccupied };

/// Voxels of an OccupancyMap between two heights, seen from above.
struct OccupancySlice {
  double resolution = 0;  ///< unit of the poses
  double origin_x = 0;    ///< world, of the corner of the first cell
  double origin_y = 0;
  int width = 0;   ///< cells along x
  int height = 0;  ///< cells along y
  /// Row by row, x first. Occupied: some voxel of the column is; free: all are free; unknown: anything else.
  std::vector<Occupancy> cells;
};

/// False in a build without OctoMap.
bool CanMapOccupancy();
/// Throws InvalidInputError that says which package is missing, unless CanMapOccupancy.
void CheckCanMapOccupancy();

/// Of points that are obstacles and end rays: an error of 1 % of their depth is expected.
constexpr float kMinOccupancyConfidence = 0.5f;
/// The default resolution, in voxels of the map.
constexpr double kOccupancyVoxels = 4;

/// Which space is occupied, free or unknown (OctoMap, with its sensor model): rays from a camera to its points pass
/// through free space and end at obstacles. In the world's frame.
class OccupancyMap {
 public:
  /// Throws InvalidInputError unless the resolution is positive and finite and CanMapOccupancy.
  /// @param resolution edge of a voxel, unit of the poses
  explicit OccupancyMap(double resolution);
  ~OccupancyMap();
  OccupancyMap(const OccupancyMap&) = delete;
  OccupancyMap& operator=(const OccupancyMap&) = delete;

  /// Those of its points that have kMinOccupancyConfidence. Throws InvalidInputError when one lies more than 32000
  /// voxels from the origin, which is as far as OctoMap goes: then it is as if the keyframe had not been given.
  void Insert(const PlacedKeyframe& keyframe);

  Occupancy At(const Eigen::Vector3d& point_in_world) const;
  /// Throws InvalidInputError unless min_height < max_height. Empty where nothing is known between them.
  OccupancySlice Slice(double min_height, double max_height) const;

  /// OctoMap's binary format (.bt), which has occupied, free and unknown. Written as all files are (AtomicFile). Throws
  /// InvalidInputError for an empty map.
  void Write(const std::filesystem::path& path) const;
  size_t nodes() const;  ///< of the tree
  double resolution() const { return resolution_; }

 private:
  struct Tree;
  const double resolution_;
  std::unique_ptr<Tree> tree_;
};

/// Of a whole map. Throws InvalidInputError for an empty one.
/// @param resolution 0: kOccupancyVoxels voxels of the map
std::unique_ptr<OccupancyMap> MakeOccupancyMap(const PlacedKeyframes& map, double resolution);

}  // namespace acmp
