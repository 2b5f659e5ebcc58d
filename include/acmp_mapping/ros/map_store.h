#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/ros/loop_correction.h"

namespace acmp {

struct MapStoreOptions {
  int max_keyframes = 500;  ///< the oldest go first, 1..1000000
  double voxel_size = 0;    ///< unit of the poses, >= 0; 0 = kAutoVoxelRatio of the first keyframe's median depth
  double map_radius = 0;  ///< unit of the poses, >= 0; keyframes farther from the newest one's camera go; 0 = no limit
};
void Validate(const MapStoreOptions& options);

constexpr double kAutoVoxelRatio = 0.005;  ///< about 2.5 px of a 500 px focal length

/// A correction that moves points by less than about a thousandth of a voxel is none: nobody sees it, and a map of many
/// points takes seconds to build. The angle is what moves points by that at 200 voxels, the median depth with
/// kAutoVoxelRatio.
constexpr double kSamePoseVoxels = 1e-3;
constexpr double kSamePoseRad = 5e-6;

struct MapStatistics {
  size_t keyframes = 0;   ///< with points
  size_t points = 0;      ///< held, all keyframes together
  double voxel_size = 0;  ///< in use; 0 = not known yet
  // Since the last Clear:
  size_t evicted = 0;            ///< keyframes that made room for later ones
  size_t evicted_by_radius = 0;  ///< keyframes that were farther than map_radius away
  size_t paths = 0;              ///< given to Repose
  size_t corrections = 0;        ///< paths that moved keyframes
  size_t reposed = 0;            ///< keyframes moved, summed over the corrections
  size_t path_poses = 0;         ///< of the last path
  size_t path_unmatched = 0;     ///< of these, poses that belong to no keyframe
};

/// The fused points of each keyframe in its own camera frame, thinned to one per voxel, with the keyframe's pose: so a
/// pose can be corrected later without matching or touching a point. Thread-safe: one mutex guards the list and is held
/// for a moment only, and clouds are immutable and shared, so that building a map holds up nobody.
///
/// Keyframes are told apart by their number, which grows with time.
class MapStore {
 public:
  explicit MapStore(const MapStoreOptions& options);

  /// Takes effect with the next keyframe; points already thinned stay as they are.
  void set_options(const MapStoreOptions& options);

  /// A keyframe whose points are still to come, or never will; it belongs to the path and can be corrected.
  /// @param world_from_cam as received
  void AddPose(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam);
  /// Once for a keyframe. Adds the pose too, if that has not been done or the keyframe was evicted meanwhile.
  void AddPoints(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam,
                 const PointCloud& points_in_camera);
  /// Better points of a keyframe that has had its own. False, and nothing is changed, where it is not in the map any
  /// more.
  bool ReplacePoints(int64_t id, const PointCloud& points_in_camera);
  /// Whether the keyframe is in the map with points, which may be none.
  bool HasPoints(int64_t id) const;
  void Clear();

  /// Time jumped back: later keyframes are another run of the frontend, perhaps in another world. Corrections of one
  /// run leave the others alone, though their stamps may be the same.
  void StartRun();

  /// Corrects poses after a loop closure, see Repose in loop_correction.h. The path also counts for keyframes of this
  /// run that come later. Only poses change: takes microseconds per keyframe. An empty path does nothing.
  ReposeResult Repose(std::vector<StampedPose> path, int64_t tolerance_ns);

  /// The map: all keyframes' points in the world, one per voxel. Takes time in proportion to the points held.
  PointCloud WorldCloud() const;

  /// Poses in use of all keyframes, with points or not, in the order of their numbers.
  std::vector<StampedPose> Path() const;

  MapStatistics statistics() const;

  /// Changes whenever the map does.
  uint64_t version() const;

 private:
  struct Keyframe {
    int64_t id = 0;
    int run = 0;
    CorrectedPose pose;
    std::shared_ptr<const PointCloud> points_in_camera;  ///< null while there are none
  };

  std::shared_ptr<const PointCloud> Thinned(const PointCloud& points);

  // All of these need the mutex.
  double VoxelSize() const { return options_.voxel_size > 0 ? options_.voxel_size : auto_voxel_size_; }
  size_t PlaceOf(int64_t id) const;  ///< index of the first keyframe that is not before this one
  bool HasPointsAt(size_t place, int64_t id) const;
  Keyframe* FindOrAdd(int64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam);
  ReposeResult ApplyPath();
  void Evict();
  void Forget(const Keyframe& keyframe, size_t* counter);

  mutable std::mutex mutex_;
  MapStoreOptions options_;
  double auto_voxel_size_ = 0;
  std::deque<Keyframe> keyframes_;  ///< in the order of their numbers
  int run_ = 0;
  std::vector<StampedPose> path_;  ///< the last one of this run, sorted
  int64_t path_tolerance_ns_ = 0;
  MapStatistics statistics_;  ///< all but the voxel size
  uint64_t version_ = 0;
};

}  // namespace acmp
