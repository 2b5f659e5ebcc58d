#pragma once

#include <openvdb/Grid.h>

#include <cstdint>

#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {

// As openvdb.h has them, which includes all of OpenVDB.
using FloatTree = openvdb::tree::Tree4<float, 5, 4, 3>::Type;
using ColorTree = openvdb::tree::Tree4<int32_t, 5, 4, 3>::Type;  ///< PackColor

/// Trees with the same blocks. In units of voxels: the coordinates of a voxel are those of its centre.
struct DistanceVolume::Grids {
  FloatTree distance{static_cast<float>(kTruncationVoxels)};  ///< voxels, positive in front
  FloatTree weight{0.0f};                                     ///< 0: not seen
  ColorTree color{0};                                         ///< PackColor
};

/// The mesh in voxels.
TriangleMesh ExtractMeshInVoxels(const FloatTree& distance, const FloatTree& weight, const ColorTree& color);

}  // namespace acmp
