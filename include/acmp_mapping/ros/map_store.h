#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

struct MapStoreOptions {
  int max_keyframes = 500;  ///< the oldest go first, 1..1000000
  double voxel_size = 0;    ///< unit of the poses, >= 0; 0 = kAutoVoxelRatio of the first keyframe's median depth
};
void Validate(const MapStoreOptions& options);

constexpr double kAutoVoxelRatio = 0.005;  ///< about 2.5 px of a 500 px focal length

struct MapStatistics {
  size_t keyframes = 0;
  size_t points = 0;      ///< held, all keyframes together
  size_t evicted = 0;     ///< keyframes that made room for later ones since the last Clear
  double voxel_size = 0;  ///< in use; 0 = not known yet
};

/// The fused points of each keyframe in its own camera frame, thinned to one per voxel, with the keyframe's pose: so a
/// pose can be corrected later without matching again. Thread-safe: one mutex guards the list, and clouds are immutable
/// and shared, so that building a map does not hold up the worker that adds keyframes.
class MapStore {
 public:
  explicit MapStore(const MapStoreOptions& options);

  /// Takes effect with the next keyframe; points already thinned stay as they are.
  void set_options(const MapStoreOptions& options);

  void Add(int64_t id, const RigidTransform& world_from_cam, const PointCloud& points_in_camera);
  void Clear();

  /// The map: all keyframes' points in the world, one per voxel. Takes time in proportion to the points held.
  PointCloud WorldCloud() const;

  MapStatistics statistics() const;

  /// Changes whenever the map does.
  uint64_t version() const;

 private:
  struct Keyframe {
    int64_t id;
    RigidTransform world_from_cam;
    std::shared_ptr<const PointCloud> points_in_camera;
  };

  mutable std::mutex mutex_;
  MapStoreOptions options_;
  double auto_voxel_size_ = 0;
  std::deque<Keyframe> keyframes_;
  size_t points_ = 0;
  size_t evicted_ = 0;
  uint64_t version_ = 0;
};

}  // namespace acmp
