#pragma once

#include "acmp_mapping/fusion/kernel/match_pixel.h"
#include "acmp_mapping/fusion/kernel/surroundings.h"

namespace acmp {

/// Deviations count up to this: beyond, it is another surface.
constexpr double kMaxUnevenness = 0.1;

/// Mean relative deviation of depths around a pixel (ForEachAround) from its plane, each at most kMaxUnevenness.
/// Unknown depths do not count; with none, or a plane that does not face the camera, it is kMaxUnevenness. A wrong
/// estimate rarely fits its surroundings: without any view this alone sorts errors better than the number of consistent
/// views does.
template <class View>
ACMP_HOST_DEVICE inline double SurfaceUnevenness(const FusionContext<View>& context, const ReferencePixel& pixel) {
  // The plane's depth is inverse to m . (u, v, 1), which is negative where the plane faces the camera.
  const double* from_pixel = context.geometry.target_from_pixel.m;
  const Vec3d& n = pixel.normal;
  const Vec3d m = {from_pixel[0] * n.x + from_pixel[3] * n.y + from_pixel[6] * n.z,
                   from_pixel[1] * n.x + from_pixel[4] * n.y + from_pixel[7] * n.z,
                   from_pixel[2] * n.x + from_pixel[5] * n.y + from_pixel[8] * n.z};
  const double here = Dot(m, pixel.homogeneous);  // times the depth
  if (!(here < 0)) return kMaxUnevenness;
  double sum = 0, weights = 0;
  ForEachAround(context.reference, pixel.col, pixel.row, [&](int col, int row, double weight) {
    const float depth = context.reference.Depth(col, row);
    if (!IsKnown(depth)) return;
    const double there = Dot(m, Vec3d{static_cast<double>(col), static_cast<double>(row), 1});
    const double deviation = std::fabs(there * depth / here - 1);
    sum += weight * (deviation < kMaxUnevenness ? deviation : kMaxUnevenness);
    weights += weight;
  });
  return weights > 0 ? sum / weights : kMaxUnevenness;
}

}  // namespace acmp
