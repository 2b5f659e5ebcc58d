#pragma once

#include "acmp_mapping/common/vector_math.h"

namespace acmp {

/// The plane n.X + d = 0 in the reference camera's frame (n: unit normal that faces the camera, so d > 0 for a plane in
/// front of it). All zero means "no hypothesis".
struct alignas(16) PlaneHypothesis {
  float nx = 0, ny = 0, nz = 0, d = 0;

  ACMP_HOST_DEVICE Vec3f normal() const { return {nx, ny, nz}; }
};

/// Inverse intrinsics of the reference camera in float: ray(u, v) = ((u - cx) / fx, (v - cy) / fy, 1).
struct RayGrid {
  float inv_fx, inv_fy, cx, cy;

  /// Point at z = 1 on the ray through the pixel; not a unit vector.
  ACMP_HOST_DEVICE Vec3f Ray(float col, float row) const { return {(col - cx) * inv_fx, (row - cy) * inv_fy, 1.0f}; }
};

/// Depth z where the ray (with ray.z = 1) meets the plane; not positive or not finite when it does not in front of the
/// camera.
ACMP_HOST_DEVICE inline float PlaneDepth(const PlaneHypothesis& plane, const Vec3f& ray) {
  return -plane.d / Dot(plane.normal(), ray);
}

/// 1 / PlaneDepth, without a singularity where the ray is parallel to the plane. Affine in the pixel's position.
ACMP_HOST_DEVICE inline float PlaneInverseDepth(const PlaneHypothesis& plane, const Vec3f& ray) {
  return -Dot(plane.normal(), ray) / plane.d;
}

/// The plane with the given unit normal through the point at depth z on the ray (ray.z = 1).
ACMP_HOST_DEVICE inline PlaneHypothesis PlaneThrough(const Vec3f& normal, const Vec3f& ray, float depth) {
  return {normal.x, normal.y, normal.z, -depth * Dot(normal, ray)};
}

}  // namespace acmp
