#pragma once

#include <cstdint>
#include <unordered_set>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/geometry/voxel.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// At one distance threshold, in percent (ETH3D's definition).
struct CloudMetrics {
  double threshold = 0;
  double accuracy = 0;  ///< share of reconstructed points within `threshold` of the ground truth, averaged over voxels
  double completeness =
      0;          ///< share of ground-truth points within `threshold` of the reconstruction, averaged over voxels
  double f1 = 0;  ///< harmonic mean
};

/// ETH3D multi-view protocol (Schoeps et al., CVPR 2017): points are binned into voxels of `voxel_size`, shares are
/// taken per voxel and averaged, so that dense regions do not dominate; two grids, shifted by half a voxel, are
/// averaged together, so that it matters less where the borders lie. Within means distance <= threshold. An empty
/// reconstruction scores 0. Throws InvalidInputError for an empty ground truth, a point that is not finite, a threshold
/// or voxel size that is not positive and finite. `observed`, if not empty, has one mark per reconstructed point: those
/// with 0 lie in space that the ground truth did not observe and are left out of accuracy (ObservedSurface makes such
/// marks); for completeness all points count. Throws InvalidInputError for another number of marks.
std::vector<CloudMetrics> EvaluateCloud(const PointCloud& reconstruction, const PointCloud& ground_truth,
                                        const std::vector<double>& thresholds, double voxel_size = 0.01,
                                        const std::vector<uint8_t>& observed = {});

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
  /// finite and the points' coordinates are finite and at most kMaxVoxels spacings from the origin.
  ObservedSurface(const PointCloud& reconstruction, double spacing, double tolerance);

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
  std::unordered_set<Voxel, VoxelHash> occupied_;  ///< by the cloud's points
};

/// Points all over a mesh, at most `spacing` apart: the middles of the equal triangles into which each triangle is cut.
/// Throws InvalidInputError unless spacing is positive and finite, and for more than 2^31 points.
PointCloud SampleMesh(const TriangleMesh& mesh, double spacing);

}  // namespace acmp
