#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/map/occupancy_map.h"

namespace acmp {

/// The greatest distance that is told, in voxels: time is in proportion to it.
constexpr int kMaxDistanceVoxels = 24;

/// What a DistanceGrid says about a point.
struct PointDistance {
  /// To the middle of the nearest obstacle's voxel, interpolated between the middles of eight voxels; unit of the
  /// poses. At most max_distance; NaN outside of the grid.
  float distance = 0;
  Eigen::Vector3f gradient = Eigen::Vector3f::Zero();  ///< of the same; 0 where all is max_distance away, or outside
  Occupancy occupancy = Occupancy::kUnknown;           ///< of the point's voxel
};

/// Distances to the nearest obstacle at one version of a map. It never changes.
class DistanceGrid {
 public:
  /// @param point in local coordinates of the map
  PointDistance At(const Eigen::Vector3d& point) const;

  double max_distance() const { return kMaxDistanceVoxels * resolution; }
  Occupancy OccupancyAt(size_t cell) const;
  float DistanceAt(size_t cell) const;  ///< of a voxel's middle
  /// Of a voxel in the box.
  size_t CellOf(const VoxelIndex& voxel) const {
    const auto from = [&](size_t i) { return static_cast<size_t>(voxel[i] - box.low[i]); };
    return (from(0) * size(1) + from(1)) * size(2) + from(2);
  }
  size_t size(size_t axis) const { return static_cast<size_t>(box.high[axis] - box.low[axis] + 1); }

  uint64_t version = 0;                              ///< of the map
  double resolution = 0;                             ///< unit of the poses
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
  VoxelBox box;
  /// Along each axis, whether what is known goes on beyond the box, at its low and its high side: there may be
  /// obstacles, so distances are at most those to that side.
  std::array<bool, 3> goes_on_below = {}, goes_on_above = {};
  bool cropped() const;  ///< it does not have all of what is known

 private:
  friend class DistanceField;
  std::vector<uint16_t> cells;  ///< z first, then y: occupancy, and the squared distance in voxels
};

/// Keeps the distances of an occupancy map up to date: exact ones, found anew in the box in which they may have
/// changed, axis by axis. Used by one thread at a time.
class DistanceField {
 public:
  /// @param unknown_is_obstacle distances are those to obstacles or to unknown space
  /// @param max_bytes of all cells: where a map has more, the grid is a box about the newest camera
  DistanceField(bool unknown_is_obstacle, size_t max_bytes);

  /// Takes over what has changed. Returns the voxels whose distance may have changed; all, where the grid is another
  /// one.
  /// @param camera the newest one, in local coordinates
  VoxelBox Update(const LiveOccupancy& occupancy, const LiveOccupancy::Change& change, const Eigen::Vector3d& camera,
                  uint64_t version);
  /// Frees all memory.
  void Clear() { grid_.reset(); }

  /// None: before Update.
  std::shared_ptr<const DistanceGrid> grid() const { return grid_; }

 private:
  bool IsObstacle(Occupancy occupancy) const {
    return occupancy == Occupancy::kOccupied || (unknown_is_obstacle_ && occupancy == Occupancy::kUnknown);
  }
  /// Whether the grid has what is known, or, if that is too much, enough about the camera.
  bool Covers(const VoxelBox& known, const VoxelIndex& camera) const;
  /// A grid without distances.
  std::shared_ptr<DistanceGrid> MakeGrid(const OccupancyMap& map, const VoxelBox& known,
                                         const VoxelIndex& camera) const;
  /// In a part of the grid, by its occupancy.
  void FindDistances(const VoxelBox& box, DistanceGrid* grid) const;

  const bool unknown_is_obstacle_;
  const size_t max_cells_;
  std::shared_ptr<const DistanceGrid> grid_;
};

}  // namespace acmp
