#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// min(delta e_j, tau_geo) of eq. 13 in px: forward-backward reprojection error of the reference pixel at `depth` with
/// the source view's own depth. The truncation value where the point is behind or outside the source, or it has no
/// depth there.
template <class Sampler>
ACMP_HOST_DEVICE inline float GeometricError(const MatchContext<Sampler>& context, float depth, int col, int row,
                                             int view) {
  const SourceView& source = context.sources[view];
  const float worst = context.options.geometric_max_px;
  if (source.depth.data == nullptr) return worst;

  const Vec3f pixel = {static_cast<float>(col), static_cast<float>(row), 1.0f};
  const Vec3f projected = depth * (source.a * pixel) + source.b;
  if (!(projected.z > 0)) return worst;
  const float inv_z = Reciprocal(projected.z);
  const float x = projected.x * inv_z;
  const float y = projected.y * inv_z;
  if (!(x >= -0.5f && y >= -0.5f && x < source.width - 0.5f && y < source.height - 0.5f)) return worst;
  // Nearest pixel: interpolation would invent depths at edges. Truncation is rounding here, as neither is below -0.5; a
  // sum that rounds up to the width or height belongs to the last pixel.
  int nearest_col = static_cast<int>(x + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  int nearest_row = static_cast<int>(y + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  if (nearest_col >= source.depth.width) nearest_col = source.depth.width - 1;
  if (nearest_row >= source.depth.height) nearest_row = source.depth.height - 1;
  const float source_depth = source.depth(nearest_col, nearest_row);
  if (!(source_depth > 0)) return worst;

  const Vec3f back = source_depth * (source.back_a * Vec3f{x, y, 1.0f}) + source.back_b;
  if (!(back.z > 0)) return worst;
  const float inv_back_z = Reciprocal(back.z);
  const float dx = back.x * inv_back_z - pixel.x;
  const float dy = back.y * inv_back_z - pixel.y;
  const float error = sqrtf(dx * dx + dy * dy);
  return error < worst ? error : worst;
}

}  // namespace acmp
