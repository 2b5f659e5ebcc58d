#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Index of the pixel of an image halved `level` times that covers pixel `index`; an odd last column or row belongs to
/// the one before. Planes are the camera's and do not change with the image's size.
ACMP_HOST_DEVICE inline int CoveringPixel(int index, int level, int halved_size) {
  const int covering = index >> level;
  return covering < halved_size ? covering : halved_size - 1;
}

/// The plane of a pixel's covering pixel, whose ray is `covering_ray`, for the pixel itself. One seen so edge-on that
/// its depth changes by a factor of two on the way, or that it lies behind the camera, gives way to one that faces the
/// camera at the same depth. None gives none.
ACMP_HOST_DEVICE inline PlaneHypothesis UpsamplePlane(const PlaneHypothesis& plane, const Vec3f& covering_ray,
                                                      const Vec3f& ray) {
  if (!(plane.d > 0)) return plane;
  const float covering_depth = PlaneDepth(plane, covering_ray);
  const float depth = PlaneDepth(plane, ray);
  if (depth > 0.5f * covering_depth && depth < 2.0f * covering_depth) return plane;
  return PlaneThrough({0, 0, -1.0f}, ray, covering_depth);
}

}  // namespace acmp
