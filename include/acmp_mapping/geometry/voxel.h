#pragma once

#include <cmath>
#include <cstdint>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/vector_math.h"

namespace acmp {

struct Voxel {
  int64_t x, y, z;
  bool operator==(const Voxel& o) const { return x == o.x && y == o.y && z == o.z; }
};

struct VoxelHash {
  size_t operator()(const Voxel& v) const {
    // Large primes per axis (Teschner et al., VMV 2003).
    return static_cast<uint64_t>(v.x) * 73856093 ^ static_cast<uint64_t>(v.y) * 19349663 ^
           static_cast<uint64_t>(v.z) * 83492791;
  }
};

/// The voxel that holds a point; the grid lies `shift` voxels before the origin.
inline Voxel VoxelOf(const Vec3f& point, double voxel_size, double shift) {
  const auto cell = [&](float x) { return static_cast<int64_t>(std::floor(x / voxel_size + shift)); };
  return {cell(point.x), cell(point.y), cell(point.z)};
}

constexpr double kMaxVoxels = 1e9;  ///< from the origin: float coordinates are coarser than any voxel there

/// False also for NaN.
inline bool FitsVoxels(const Vec3f& point, double voxel_size) {
  const auto good = [limit = kMaxVoxels * voxel_size](float x) { return std::abs(x) <= limit; };
  return good(point.x) && good(point.y) && good(point.z);
}

/// Throws InvalidInputError unless the value is positive and finite.
inline void CheckPositive(const char* name, double value) {
  if (!(std::isfinite(value) && value > 0)) {
    throw InvalidInputError(Concat(name, " = ", value, ": must be positive and finite"));
  }
}

}  // namespace acmp
