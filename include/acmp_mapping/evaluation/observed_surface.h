#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// Ground truth of depth maps with known cameras: what they saw as one cloud, and which points of a reconstruction lie
/// where they saw. Takes one map at a time; memory grows with the surface, not with the number of maps.
///
/// The cloud: each pixel with known depth is taken to the world as the point at its centre. Of the points in a voxel of
/// `spacing` (a grid anchored at the origin) the first stays, unchanged, in the order of the calls and then of the
/// rows. So no place that was seen is farther than sqrt(3) spacing from a point of the cloud.
///
/// Observed: a map observes a point that lies in front of its camera, projects on a pixel with known depth z (the
/// nearest pixel centre) and has itself a depth of at most z + `tolerance` in that camera. The space up to a surface
/// counts, what is hidden behind it does not: there the map says nothing. A point is observed if at least one map
/// observes it.
class ObservedSurface {
 public:
  /// `reconstruction` must outlive the object. Throws InvalidInputError unless spacing and tolerance are positive and
  /// finite and the points' coordinates are finite.
  ObservedSurface(const PointCloud& reconstruction, double spacing, double tolerance);
  ~ObservedSurface();

  /// `depth`: unknown where not finite and > 0. `camera` is of the map's size. Throws InvalidInputError for another
  /// size, and for a point farther than 1e9 times the spacing from the origin.
  void Add(const DepthMap& depth, const PinholeCamera& camera, const RigidTransform& cam_from_world);

  const PointCloud& cloud() const { return cloud_; }
  const std::vector<uint8_t>& observed() const { return observed_; }  ///< per point of the reconstruction, 0 or 1

 private:
  void AddPoints(const DepthMap& depth, const PinholeCamera& camera, const RigidTransform& world_from_cam);
  void MarkObserved(const DepthMap& depth, const PinholeCamera& camera, const RigidTransform& cam_from_world);

  const PointCloud& reconstruction_;
  double spacing_, tolerance_;
  PointCloud cloud_;
  std::vector<uint8_t> observed_;
  struct OccupiedVoxels;
  std::unique_ptr<OccupiedVoxels> occupied_;
};

}  // namespace acmp
