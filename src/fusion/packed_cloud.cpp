#include "acmp_mapping/fusion/packed_cloud.h"

#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/label_votes.h"

namespace acmp {
namespace {

constexpr uint32_t kNoNormal = 4095;  ///< in place of both coordinates
constexpr int kNormalSteps = 2047;    ///< from -1 to 0 and from 0 to 1
constexpr float kFullConfidence = 65535;

/// Coordinates x, y of a point of the octahedron |x| + |y| + |z| = 1, seen along z.
struct Flat {
  float x, y;
};

float SignOf(float value) { return value < 0 ? -1.0f : 1.0f; }

/// From the half with z < 0 to where it lies when it is folded out around the other one, and back. Adding 0 makes -0 to
/// 0: so the two places on the outer edge that are one direction have the same bits.
Flat FoldedOver(const Flat& p) {
  return {(1 - std::abs(p.y)) * SignOf(p.x) + 0.0f, (1 - std::abs(p.x)) * SignOf(p.y) + 0.0f};
}

uint32_t StepOf(float coordinate) {
  return static_cast<uint32_t>(std::lround(coordinate * kNormalSteps) + kNormalSteps);
}
float CoordinateOf(uint32_t step) { return static_cast<float>(static_cast<int>(step) - kNormalSteps) / kNormalSteps; }

}  // namespace

PackedCloud::PackedCloud(const PointCloud& points) : points_(points.size()) {
  if (HasLabels(points)) labels_.resize(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& point = points[i];
    if (!labels_.empty()) labels_[i] = point.label;
    if (!(point.confidence >= 0 && point.confidence <= 1)) {
      throw InvalidInputError(Concat("confidence of point ", i, " = ", point.confidence, ": must be in [0, 1]"));
    }
    Point& packed = points_[i];
    packed.position = point.position;
    const Vec3f& n = point.normal;
    const float length = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
    packed.normal_x = packed.normal_y = kNoNormal;
    if (length > 0 && std::isfinite(length)) {
      Flat flat = {n.x / length, n.y / length};
      if (n.z < 0) flat = FoldedOver(flat);
      packed.normal_x = StepOf(flat.x) & 0xfff;
      packed.normal_y = StepOf(flat.y) & 0xfff;
    }
    packed.red = point.color.r;
    packed.green = point.color.g;
    packed.blue = point.color.b;
    packed.confidence = static_cast<uint32_t>(std::lround(point.confidence * kFullConfidence)) & 0xffff;
  }
}

SurfacePoint PackedCloud::operator[](size_t index) const {
  const Point& packed = points_[index];
  SurfacePoint point;
  point.position = packed.position;
  point.normal = {0, 0, 0};
  if (packed.normal_x != kNoNormal) {
    Flat flat = {CoordinateOf(packed.normal_x), CoordinateOf(packed.normal_y)};
    const float z = 1 - std::abs(flat.x) - std::abs(flat.y);
    if (z < 0) flat = FoldedOver(flat);
    const float length = std::sqrt(flat.x * flat.x + flat.y * flat.y + z * z);
    point.normal = {flat.x / length, flat.y / length, z / length};
  }
  point.color = {static_cast<unsigned char>(packed.red), static_cast<unsigned char>(packed.green),
                 static_cast<unsigned char>(packed.blue)};
  point.label = labels_.empty() ? Label{0} : labels_[index];
  point.confidence = static_cast<float>(packed.confidence) / kFullConfidence;
  return point;
}

PointCloud PackedCloud::Unpack() const {
  PointCloud points(size());
  for (size_t i = 0; i < points.size(); ++i) points[i] = (*this)[i];
  return points;
}

}  // namespace acmp
