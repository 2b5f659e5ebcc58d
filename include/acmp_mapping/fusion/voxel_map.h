#pragma once

#include <cstddef>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// One averaged point per occupied voxel (position, normal, colour and confidence, weighted by confidence). Grid of
/// `voxel_size` anchored at the origin; throws InvalidInputError unless voxel_size > 0 and finite. Order of the result is
/// deterministic.
PointCloud VoxelFilter(const PointCloud& points, float voxel_size);

/// Points moved by a rigid motion, normals rotated.
PointCloud Transform(const RigidTransform& target_from_source, const PointCloud& points);

}  // namespace acmp
