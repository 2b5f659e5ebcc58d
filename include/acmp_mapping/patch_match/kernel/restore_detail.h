#pragma once

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"

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

/// The estimate of the next coarser scale: the image halved once more.
struct CoarserEstimate {
  ImageView<const PlaneHypothesis> planes;
  RayGrid rays;
};

/// Joint bilateral upsampling (Kopf et al., SIGGRAPH 2007) of a coarser estimate: the mean of the depths of the 5 x 5
/// pixels around, weighted by their distance in the coarser map and by how alike the image is at their places. The
/// normal is that of the pixel that covers this one. Pixels without a plane do not count; zero where none has one.
template <class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis UpsampleJointly(const MatchContext<Sampler>& context,
                                                        const CoarserEstimate& coarser, int col, int row) {
  constexpr int kReach = 2;
  constexpr float kSigmaPx = 0.5f;     // of the coarser map
  constexpr float kSigmaGray = 25.5f;  // a tenth of the range
  const auto clamped = [](int value, int last) { return value > last ? last : value; };
  const int covering_col = clamped(col / 2, coarser.planes.width - 1);
  const int covering_row = clamped(row / 2, coarser.planes.height - 1);
  const float x = 0.5f * static_cast<float>(col) - 0.25f, y = 0.5f * static_cast<float>(row) - 0.25f;
  const float gray = context.sampler.Reference(col, row);
  float sum = 0, weights = 0;
  for (int r = covering_row - kReach; r <= covering_row + kReach; ++r) {
    for (int c = covering_col - kReach; c <= covering_col + kReach; ++c) {
      if (!coarser.planes.Contains(c, r)) continue;
      const PlaneHypothesis plane = coarser.planes(c, r);
      const float depth = PlaneDepth(plane, coarser.rays.Ray(static_cast<float>(c), static_cast<float>(r)));
      if (!(plane.d > 0 && depth > 0)) continue;
      const float dx = static_cast<float>(c) - x, dy = static_cast<float>(r) - y;
      const float difference =
          context.sampler.Reference(clamped(2 * c, context.width - 1), clamped(2 * r, context.height - 1)) - gray;
      const float weight = expf(
          -0.5f * ((dx * dx + dy * dy) / (kSigmaPx * kSigmaPx) + difference * difference / (kSigmaGray * kSigmaGray)));
      sum += weight * depth;
      weights += weight;
    }
  }
  if (!(weights > 0)) return {};
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const float depth = Clamp(sum / weights, context.depth_min, context.depth_max);
  const PlaneHypothesis covering = coarser.planes(covering_col, covering_row);
  const PlaneHypothesis plane = PlaneThrough(covering.normal(), ray, depth);
  return covering.d > 0 && plane.d > 0 ? plane : PlaneThrough({0, 0, -1.0f}, ray, depth);
}

/// The detail restorer of ACMM (section 4 of ACMH's paper) for one pixel of a photometric estimate: it takes the
/// coarser scale's plane, with its photometric cost here, unless its own costs less by more than xi, as a detail that
/// the coarser scale does not have. Nothing for a pixel that the mask ignores.
/// @param context with planes and costs of the photometric estimate
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline void RestorePixel(const MatchContext<Sampler>& context, const CoarserEstimate& coarser, int col,
                                          int row, const Group& group, PixelScratch* scratch) {
  constexpr float kXi = 0.1f;
  if (context.IsMasked(col, row)) return;
  const PlaneHypothesis plane = UpsampleJointly(context, coarser, col, row);
  if (!(plane.d > 0)) return;
  uint32_t views;
  const float cost = InitialCost<Pass::kPhotometric, Method::kAcmh>(context, col, row, plane, group, scratch, &views);
  if (group.Rank() != 0 || cost - context.cost(col, row) > kXi) return;
  context.planes(col, row) = plane;
  context.cost(col, row) = cost;
}

template <class Sampler>
inline void RestorePixel(const MatchContext<Sampler>& context, const CoarserEstimate& coarser, int col, int row) {
  StackScratch scratch;
  RestorePixel(context, coarser, col, row, SingleThread(), &scratch.shared);
}

}  // namespace acmp
