#pragma once

#include <cstddef>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// One averaged point per occupied voxel (position, normal, colour and confidence, weighted by confidence). Grid of
/// `voxel_size` anchored at the origin; a voxel whose confidences are all 0 is averaged without weights. Throws
/// InvalidInputError unless voxel_size > 0 and finite, positions are finite and within 2^31 voxels of the origin and
/// confidences are in 0..1. Voxels come in the order of their coordinates.
PointCloud VoxelFilter(const PointCloud& points, float voxel_size);

/// Points moved by a rigid motion, normals rotated.
PointCloud Transform(const RigidTransform& target_from_source, const PointCloud& points);

}  // namespace acmp
