#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// Inverse depth of a source's pixel: of the nearest to a position inside the image, as interpolation would invent
/// depths at edges. 0: unknown. Ours reads the halved map.
template <Method kMethod, class Sampler>
ACMP_HOST_DEVICE inline float InverseSourceDepth(const MatchContext<Sampler>& context, int view, float x, float y) {
  // Truncation is rounding here, as neither is below -0.5; a sum that rounds up to the width or height belongs to the
  // last pixel.
  int col = static_cast<int>(x + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  int row = static_cast<int>(y + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  if constexpr (kMethod == Method::kOurs) {
    const HalvedDepth& depth = context.sources[view].depth;
    col /= 2;
    row /= 2;
    if (col >= depth.inverse.width) col = depth.inverse.width - 1;
    if (row >= depth.inverse.height) row = depth.inverse.height - 1;
    return depth.step * static_cast<float>(depth.inverse(col, row));
  } else {
    const ImageView<const float>& depth = context.full_depths[view];
    if (col >= depth.width) col = depth.width - 1;
    if (row >= depth.height) row = depth.height - 1;
    return InverseOfDepth(depth(col, row));
  }
}

/// min(delta e_j, tau_geo) of eq. 13 in px: forward-backward reprojection error of the reference pixel at `depth` with
/// the source view's own depth. The truncation value where the point is behind or outside the source, or it has no
/// depth there.
template <Method kMethod = Method::kOurs, class Sampler>
ACMP_HOST_DEVICE inline float GeometricError(const MatchContext<Sampler>& context, float depth, int col, int row,
                                             int view) {
  const SourceView& source = context.sources[view];
  const float worst = context.options.geometric_max_px;
  if (kMethod == Method::kOurs ? source.depth.empty() : context.full_depths[view].empty()) return worst;

  const Vec3f pixel = {static_cast<float>(col), static_cast<float>(row), 1.0f};
  const Vec3f projected = depth * (source.a * pixel) + source.b;
  if (!(projected.z > 0)) return worst;
  const float inv_z = Reciprocal(projected.z);
  const float x = projected.x * inv_z;
  const float y = projected.y * inv_z;
  if (!(x >= -0.5f && y >= -0.5f && x < source.width - 0.5f && y < source.height - 0.5f)) return worst;
  const float inverse = InverseSourceDepth<kMethod>(context, view, x, y);
  if (!(inverse > 0)) return worst;

  // The point over its depth in the source: the same pixel, and the same sign of z.
  const Vec3f back = source.back_a * Vec3f{x, y, 1.0f} + inverse * source.back_b;
  if (!(back.z > 0)) return worst;
  const float inv_back_z = Reciprocal(back.z);
  const float dx = back.x * inv_back_z - pixel.x;
  const float dy = back.y * inv_back_z - pixel.y;
  const float error = sqrtf(dx * dx + dy * dy);
  return error < worst ? error : worst;
}

}  // namespace acmp
