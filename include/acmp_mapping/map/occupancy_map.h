#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/map/map_store.h"

namespace acmp {

enum class Occupancy : signed char { kUnknown, kFree, kOccupied };

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

/// Of points that are obstacles and end rays: an error of 1 % of their depth is expected.
constexpr float kMinOccupancyConfidence = 0.5f;
/// The default resolution, in voxels of the map.
constexpr double kOccupancyVoxels = 4;

/// What an OccupancyMap may cost. What is farther away or seen in more detail costs more without bound: the map of a
/// scene is made of larger voxels instead.
struct OccupancyLimits {
  size_t max_bytes = 1000000000;        ///< of its tree, its slice and one keyframe's rays
  size_t max_ray_voxels = 100000000;    ///< that all rays go through, which is what takes the time
  std::function<void()> check = [] {};  ///< called before each keyframe; what it throws ends the work
};

/// Which space is occupied, free or unknown (OctoMap, with its sensor model): rays from a camera to its points pass
/// through free space and end at obstacles. In the world's frame.
class OccupancyMap {
 public:
  /// Throws InvalidInputError unless the resolution is positive and finite.
  /// @param resolution edge of a voxel, unit of the poses
  explicit OccupancyMap(double resolution, OccupancyLimits limits = {});
  ~OccupancyMap();
  OccupancyMap(const OccupancyMap&) = delete;
  OccupancyMap& operator=(const OccupancyMap&) = delete;

  /// Adds those of their points that have kMinOccupancyConfidence. False when this would cost more than the limits, or
  /// something lies more than 32000 voxels from the origin, which is as far as OctoMap goes: then only larger voxels
  /// help, and this map is of no use.
  bool Insert(const std::vector<PlacedKeyframe>& keyframes);

  /// Throws InvalidInputError unless min_height < max_height. Empty where nothing is known between them.
  OccupancySlice Slice(double min_height, double max_height) const;

  /// OctoMap's binary format (.bt), which has occupied, free and unknown. Written as all files are (AtomicFile). Throws
  /// InvalidInputError for an empty map.
  void Write(const std::filesystem::path& path) const;
  size_t nodes() const;  ///< of the tree
  double resolution() const { return resolution_; }

 private:
  struct Tree;
  struct Rays;
  /// Of a keyframe, one for each voxel in which points lie; none if something lies too far away.
  std::optional<Rays> FindRays(const PlacedKeyframe& keyframe) const;
  /// Whether the rays of all keyframes are within the limits.
  bool CanInsert(const std::vector<PlacedKeyframe>& keyframes) const;

  const double resolution_;
  const OccupancyLimits limits_;
  std::unique_ptr<Tree> tree_;
};

/// Whether z of the world points up, by cameras that are tilted up or down, but hardly to a side (x is level), and
/// whose images are upright or that look down. False for the world of most frontends of one camera, whose z points
/// forward, and for cameras that are mounted on their side. A capture counts once.
bool ZPointsUp(const std::vector<PlacedKeyframe>& keyframes);

/// Of a whole map. Throws InvalidInputError for an empty one.
/// @param resolution 0: kOccupancyVoxels voxels of the map. The result has the double of it, as often as the limits
/// need
std::unique_ptr<OccupancyMap> MakeOccupancyMap(const PlacedKeyframes& map, double resolution,
                                               const OccupancyLimits& limits = {});

}  // namespace acmp
