#pragma once

#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {

/// Deviations count up to this: beyond, it is another surface.
constexpr double kMaxUnevenness = 0.1;

/// What a pixel of another colour counts for: less, as it is more likely of another surface. A pixel on a small thing
/// in front of a wall is compared with the rest of the thing then, and one of the wall that was given the thing's depth
/// with the wall.
/// @param distance of the colours, ColorDistance; half of the weight is left at 20
ACMP_HOST_DEVICE inline double ColorWeight(int distance) {
  constexpr double kSquaredHalf = 400;
  return kSquaredHalf / (kSquaredHalf + static_cast<double>(distance) * distance);
}

/// Mean relative deviation of depths around a pixel from its plane, each at most kMaxUnevenness, weighted by
/// ColorWeight where there are colours: of 24 pixels, in 8 directions at 4, 8 and 16 px. Unknown depths do not count;
/// with none, or a plane that does not face the camera, it is kMaxUnevenness. A wrong estimate rarely fits its
/// surroundings: without any view this alone sorts errors better than the number of consistent views does.
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
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  const bool has_color = !context.reference.color.empty();
  double sum = 0, weights = 0;
  for (int step = 4; step <= 16; step *= 2) {
    const int diagonal = step * 3 / 4;  // nearly as far: 0.75 sqrt(2) = 1.06
    for (int place = 0; place < 9; ++place) {
      if (place == 4) continue;  // the pixel itself
      const int right = place % 3 - 1, down = place / 3 - 1;
      const int length = right == 0 || down == 0 ? step : diagonal;
      const int col = pixel.col + right * length, row = pixel.row + down * length;
      if (col < 0 || row < 0 || col >= width || row >= height) continue;
      const float depth = context.reference.Depth(col, row);
      if (!IsKnown(depth)) continue;
      const double there = Dot(m, Vec3d{static_cast<double>(col), static_cast<double>(row), 1});
      const double deviation = std::fabs(there * depth / here - 1);
      const double weight = has_color ? ColorWeight(ColorDistance(context.reference.Color(pixel.col, pixel.row),
                                                                  context.reference.Color(col, row)))
                                      : 1.0;
      sum += weight * (deviation < kMaxUnevenness ? deviation : kMaxUnevenness);
      weights += weight;
    }
  }
  return weights > 0 ? sum / weights : kMaxUnevenness;
}

}  // namespace acmp
