#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"

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

}  // namespace acmp
