#pragma once

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// Uniform in inverse depth over the range.
template <class Sampler>
ACMP_HOST_DEVICE inline float RandomDepth(const MatchContext<Sampler>& context, RandomStream* random) {
  const float u = random->NextUniform();
  const float low = context.depth_min, high = context.depth_max;
  return Clamp(low * high / (high + u * (low - high)), low, high);  // rounding must not leave the range
}

/// Uniform on the half sphere that faces the camera along `ray`.
ACMP_HOST_DEVICE inline Vec3f RandomNormal(const Vec3f& ray, RandomStream* random) {
  const float z = random->NextUniform(-1.0f, 1.0f);
  const float angle = random->NextUniform(0.0f, 6.283185307179586f);
  const float radius = sqrtf(1.0f - z * z);
  float sine, cosine;
  SinCos(angle, &sine, &cosine);
  const Vec3f normal = {radius * cosine, radius * sine, z};
  return Dot(normal, ray) < 0 ? normal : -1.0f * normal;
}

/// The normal turned by up to +-`max_angle` rad about each axis (Euler angles); unchanged if that would turn it away
/// from the camera.
ACMP_HOST_DEVICE inline Vec3f PerturbNormal(const Vec3f& normal, const Vec3f& ray, float max_angle,
                                            RandomStream* random) {
  const float ax = random->NextUniform(-max_angle, max_angle);
  const float ay = random->NextUniform(-max_angle, max_angle);
  const float az = random->NextUniform(-max_angle, max_angle);
  float sx, cx, sy, cy, sz, cz;
  SinCos(ax, &sx, &cx);
  SinCos(ay, &sy, &cy);
  SinCos(az, &sz, &cz);
  const Vec3f about_x = {normal.x, cx * normal.y - sx * normal.z, sx * normal.y + cx * normal.z};
  const Vec3f about_y = {cy * about_x.x + sy * about_x.z, about_x.y, cy * about_x.z - sy * about_x.x};
  const Vec3f turned = Normalized(Vec3f{cz * about_y.x - sz * about_y.y, sz * about_y.x + cz * about_y.y, about_y.z});
  return Dot(turned, ray) < 0 ? turned : normal;
}

}  // namespace acmp
