#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// A cloud in 20 bytes per point instead of 32; 21 where points have labels. Positions, colours and labels keep their
/// bits. Normals are unit vectors within 0.06 degrees of what was given, in 2 x 12 bits of an octahedron (Cigolle et
/// al., A Survey of Efficient Representations for Independent Unit Vectors, JCGT 2014), or 0 where 0 or NaN was given;
/// confidences are multiples of 1 / 65535. Packed again they stay the same.
class PackedCloud {
 public:
  PackedCloud() = default;
  /// Throws InvalidInputError unless confidences are in 0..1.
  explicit PackedCloud(const PointCloud& points);

  size_t size() const { return points_.size(); }
  bool empty() const { return points_.empty(); }
  SurfacePoint operator[](size_t index) const;
  PointCloud Unpack() const;

 private:
  struct Point {
    Vec3f position;
    uint32_t normal_x : 12, normal_y : 12, red : 8;
    uint32_t green : 8, blue : 8, confidence : 16;
  };
  static_assert(sizeof(Point) == 20, "what a map takes");

  std::vector<Point> points_;
  std::vector<Label> labels_;  ///< of each point; empty: none has one
};
using PackedCloudPtr = std::shared_ptr<const PackedCloud>;

}  // namespace acmp
