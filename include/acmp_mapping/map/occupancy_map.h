#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
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

/// What an OccupancyMap may cost, and what is an obstacle. What is farther away or seen in more detail costs more
/// without bound: the map of a scene is made of larger voxels instead.
struct OccupancyLimits {
  size_t max_bytes = 1000000000;        ///< of its voxels, its slice and one keyframe's rays
  std::function<void()> check = [] {};  ///< called before each keyframe; what it throws ends the work
  std::set<Label> passable = {};        ///< of points that are no obstacles, as grass: rays go through them
};

/// A voxel: floor(coordinate / resolution).
using VoxelIndex = std::array<int32_t, 3>;

/// Voxels from one corner to the other, both included; none where some `low` is greater.
struct VoxelBox {
  VoxelIndex low = {std::numeric_limits<int32_t>::max(), std::numeric_limits<int32_t>::max(),
                    std::numeric_limits<int32_t>::max()};
  VoxelIndex high = {std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::min(),
                     std::numeric_limits<int32_t>::min()};
  bool empty() const { return low[0] > high[0] || low[1] > high[1] || low[2] > high[2]; }
  void Add(const VoxelIndex& voxel);
  bool Contains(const VoxelIndex& voxel) const;
};

/// Which space is occupied, free or unknown: rays from a camera to its points pass through free space and end at
/// obstacles. A ray ends early where it joins another one of its keyframe. A voxel counts the keyframes that see an
/// obstacle in it and those that see through it, so that a keyframe can be taken out again. It is occupied where its
/// probability is at least 0.5 by OctoMap's sensor model (Hornung et al., Autonomous Robots 2013, eq. 2 with 0.7 and
/// 0.4), without the clamping of eq. 4: what has gone leaves the map itself (LookAroundNext).
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
  /// Takes out what Insert has added of exactly this keyframe.
  void Remove(const PlacedKeyframe& keyframe);
  /// Voxels that have become occupied, free or unknown since the last call; some may be what they were before. None:
  /// any may have, as at the first call, or where they are too many.
  std::optional<std::vector<VoxelIndex>> TakeChanged();

  Occupancy At(const VoxelIndex& voxel) const;
  /// Of all voxels of a box, z first, then y.
  void Read(const VoxelBox& box, std::vector<Occupancy>* voxels) const;
  VoxelBox KnownBox() const;  ///< that contains all voxels that are not unknown

  /// Throws InvalidInputError unless min_height < max_height. Empty where nothing is known between them.
  OccupancySlice Slice(double min_height, double max_height) const;

  /// OctoMap's binary format (.bt), which has occupied, free and unknown. Written as all files are (AtomicFile). Throws
  /// InvalidInputError for an empty map. Returns the number of the tree's nodes.
  size_t Write(const std::filesystem::path& path) const;
  size_t voxels() const;  ///< that are not unknown
  size_t bytes() const;   ///< of all voxels
  double resolution() const { return resolution_; }

 private:
  struct Voxels;
  struct Rays;
  /// Of a keyframe; none if something lies too far away, or this takes more than the limits.
  std::unique_ptr<Rays> FindRays(const PlacedKeyframe& keyframe) const;
  /// @param sign 1 or -1
  void Count(const Rays& rays, int sign);

  const double resolution_;
  const OccupancyLimits limits_;
  std::unique_ptr<Voxels> voxels_;
  std::optional<std::vector<VoxelIndex>> changed_;  ///< none: nobody has asked yet, or too many
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

/// The occupancy of a map while it grows: keyframes that are new are added, those that have moved or have other points
/// are taken out and added again. It is what MakeOccupancyMap makes, but that keyframes that have moved by less than
/// kMovedVoxels are where they were, and that voxels stay larger, once they had to, until the map begins anew. Used by
/// one thread at a time.
class LiveOccupancy {
 public:
  static constexpr double kMovedVoxels = 0.25;

  explicit LiveOccupancy(const OccupancyLimits& limits) : limits_(limits) {}

  /// What has changed since the last update.
  struct Change {
    bool anew = false;                ///< all of it; no voxels are named
    std::vector<VoxelIndex> changed;  ///< see TakeChanged
  };
  /// Takes over a map. What a limit's check throws leaves it empty, to begin anew.
  Change Update(const PlacedKeyframes& map);
  /// Frees all memory.
  void Clear();

  /// None for an empty map.
  const OccupancyMap* map() const { return map_.get(); }
  /// Of the local coordinates, in the world.
  const Eigen::Vector3d& origin() const { return origin_; }

 private:
  /// False: the limits ask for larger voxels.
  bool Follow(const PlacedKeyframes& map);

  const OccupancyLimits limits_;
  double voxel_size_ = 0;  ///< of the map's points
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::unique_ptr<OccupancyMap> map_;
  std::map<KeyframeKey, PlacedKeyframe> keyframes_;  ///< as they are in it
};

}  // namespace acmp
