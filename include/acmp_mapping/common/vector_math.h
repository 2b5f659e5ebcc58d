#pragma once

#include <cmath>

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Small trivially copyable vectors and matrices for code shared by host and device; host-only code uses Eigen.
template <class T>
struct Vec3 {
  using Scalar = T;
  T x, y, z;
};

/// Row-major 3x3 matrix.
template <class T>
struct Mat3 {
  T m[9];
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;
using Mat3f = Mat3<float>;

template <class T>
ACMP_HOST_DEVICE inline Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
ACMP_HOST_DEVICE inline Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
ACMP_HOST_DEVICE inline Vec3<T> operator*(typename Vec3<T>::Scalar s, const Vec3<T>& a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <class T>
ACMP_HOST_DEVICE inline T Dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
ACMP_HOST_DEVICE inline Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
ACMP_HOST_DEVICE inline T Norm(const Vec3<T>& a) {
  return std::sqrt(Dot(a, a));
}
template <class T>
ACMP_HOST_DEVICE inline Vec3<T> Normalized(const Vec3<T>& a) {
  return (T(1) / Norm(a)) * a;
}
template <class T>
ACMP_HOST_DEVICE inline Vec3<T> operator*(const Mat3<T>& a, const Vec3<T>& v) {
  return {a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
          a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z};
}

/// `value` limited to [low, high]; NaN becomes `low`.
ACMP_HOST_DEVICE inline float Clamp(float value, float low, float high) {
  return value > low ? (value < high ? value : high) : low;
}

}  // namespace acmp
