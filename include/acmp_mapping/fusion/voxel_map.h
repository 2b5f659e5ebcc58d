#pragma once

#include <cstddef>
#include <vector>

#include "acmp_mapping/fusion/packed_cloud.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// One averaged point per occupied voxel (position, normal, colour and confidence, weighted by confidence, as are votes
/// for its label). Grid of
/// `voxel_size` seeded at the origin; a voxel whose confidences are all 0 is averaged without weights. Throws
/// InvalidInputError unless voxel_size > 0 and finite, positions are finite and within 2^31 voxels of the origin,
/// confidences are in 0..1 and there are less than 2^32 points. Voxels come in the order of their coordinates.
PointCloud VoxelFilter(const PointCloud& points, float voxel_size);
/// What VoxelFilter throws for points that it refuses, without filtering.
void CheckPoints(const PointCloud& points, float voxel_size);

/// Positions times `scale`, rounded to float32.
PointCloud Scaled(PointCloud points, double scale);

/// Somebody else's PointCloud or PackedCloud and where it lies.
template <class Cloud>
struct PlacedCloud {
  RigidTransform target_from_cloud = RigidTransform::Identity();
  const Cloud* points = nullptr;
  double scale = 1;  ///< of the positions, before they are moved
};

/// VoxelFilter of all clouds in the target frame, one after the other: positions are scaled and moved and normals
/// rotated, then rounded to float32. Needs 32 bytes per point besides the result, since points are moved when they are
/// read and never stored.
PointCloud MergeClouds(const std::vector<PlacedCloud<PointCloud>>& clouds, float voxel_size);
PointCloud MergeClouds(const std::vector<PlacedCloud<PackedCloud>>& clouds, float voxel_size);

}  // namespace acmp
