#pragma once

#include <cstddef>
#include <cstdint>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// Points as PCD files and ROS messages have them: x y z rgb normal_x normal_y normal_z confidence, each a
/// little-endian float32; the bits of rgb are 0x00rrggbb, as PCL reads it.
constexpr const char* kPackedFields[] = {"x", "y", "z", "rgb", "normal_x", "normal_y", "normal_z", "confidence"};
constexpr size_t kPackedPointBytes = 32;

/// @param target kPackedPointBytes per point
void PackPoints(const SurfacePoint* points, size_t count, uint8_t* target);

/// Back again, without a change.
/// @param source kPackedPointBytes per point
PointCloud UnpackPoints(const uint8_t* source, size_t count);

}  // namespace acmp
