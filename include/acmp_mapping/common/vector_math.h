#pragma once

#include <cmath>

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Small trivially copyable vectors and matrices for code shared by host and device; host-only code uses Eigen.
struct Vec3f {
  float x, y, z;
};

/// Row-major 3x3 matrix.
struct Mat3f {
  float m[9];
};

ACMP_HOST_DEVICE inline Vec3f operator+(const Vec3f& a, const Vec3f& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
ACMP_HOST_DEVICE inline Vec3f operator-(const Vec3f& a, const Vec3f& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
ACMP_HOST_DEVICE inline Vec3f operator*(float s, const Vec3f& a) { return {s * a.x, s * a.y, s * a.z}; }
ACMP_HOST_DEVICE inline float Dot(const Vec3f& a, const Vec3f& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
ACMP_HOST_DEVICE inline Vec3f Cross(const Vec3f& a, const Vec3f& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
ACMP_HOST_DEVICE inline float Norm(const Vec3f& a) { return sqrtf(Dot(a, a)); }
ACMP_HOST_DEVICE inline Vec3f Normalized(const Vec3f& a) { return (1.0f / Norm(a)) * a; }
ACMP_HOST_DEVICE inline Vec3f operator*(const Mat3f& a, const Vec3f& v) {
  return {a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
          a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z};
}

/// `value` limited to [low, high]; NaN becomes `low`.
ACMP_HOST_DEVICE inline float Clamp(float value, float low, float high) {
  return value > low ? (value < high ? value : high) : low;
}

}  // namespace acmp
