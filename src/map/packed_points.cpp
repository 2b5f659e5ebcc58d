#include "acmp_mapping/map/packed_points.h"

#include <cstring>

namespace acmp {
namespace {

struct Packed {
  float x, y, z;
  uint8_t b, g, r, zero;
  float normal_x, normal_y, normal_z, confidence;
};
static_assert(sizeof(Packed) == kPackedPointBytes, "eight float32 fields");

}  // namespace

void PackPoints(const SurfacePoint* points, size_t count, uint8_t* target) {
  for (size_t i = 0; i < count; ++i) {
    const SurfacePoint& p = points[i];
    const Packed packed = {p.position.x, p.position.y, p.position.z, p.color.b,   p.color.g, p.color.r, 0,
                           p.normal.x,   p.normal.y,   p.normal.z,   p.confidence};
    std::memcpy(target + i * kPackedPointBytes, &packed, kPackedPointBytes);
  }
}

PointCloud UnpackPoints(const uint8_t* source, size_t count) {
  PointCloud points;
  points.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    Packed p;
    std::memcpy(&p, source + i * kPackedPointBytes, kPackedPointBytes);
    points.push_back({{p.x, p.y, p.z}, {p.normal_x, p.normal_y, p.normal_z}, {p.r, p.g, p.b}, p.confidence});
  }
  return points;
}

}  // namespace acmp
