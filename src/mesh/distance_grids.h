#pragma once

#include <openvdb/Grid.h>

#include <Eigen/Core>
#include <cmath>
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

/// The mesh in voxels. @param distance all leaves of the others, or some with all around them: then its border is
/// missing
TriangleMesh ExtractMeshInVoxels(const FloatTree& distance, const FloatTree& weight, const ColorTree& color);

/// A mean colour in 32 bits: quarters of a grey level of red, green and blue, 10 bits each.
inline uint32_t PackColor(const Eigen::Vector3f& color) {
  const auto quarters = [](float value) { return static_cast<uint32_t>(std::lround(value * 4)); };
  return quarters(color.x()) << 20 | quarters(color.y()) << 10 | quarters(color.z());
}

inline Eigen::Vector3f UnpackColor(uint32_t packed) {
  const auto grey = [packed](int shift) { return static_cast<float>(packed >> shift & 1023u) / 4; };
  return {grey(20), grey(10), grey(0)};
}

inline Eigen::Vector3f ToVector(const Rgb& color) {
  return {static_cast<float>(color.r), static_cast<float>(color.g), static_cast<float>(color.b)};
}

/// @param color 0..255
inline Rgb ToRgb(const Eigen::Vector3f& color) {
  const auto byte = [](float value) { return static_cast<unsigned char>(std::lround(value)); };
  return {byte(color.x()), byte(color.y()), byte(color.z())};
}

}  // namespace acmp
