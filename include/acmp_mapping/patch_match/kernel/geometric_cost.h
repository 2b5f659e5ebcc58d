#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// min(delta e_j, tau_geo) of eq. 13 in px: forward-backward reprojection error of the reference pixel at `depth` with
/// the source view's own depth, as its halved map has it. The truncation value where the point is behind or outside the
/// source, or it has no depth there.
template <class Sampler>
ACMP_HOST_DEVICE inline float GeometricError(const MatchContext<Sampler>& context, float depth, int col, int row,
                                             int view) {
  const SourceView& source = context.sources[view];
  const float worst = context.options.geometric_max_px;
  if (source.depth.empty()) return worst;

  const Vec3f pixel = {static_cast<float>(col), static_cast<float>(row), 1.0f};
  const Vec3f projected = depth * (source.a * pixel) + source.b;
  if (!(projected.z > 0)) return worst;
  const float inv_z = Reciprocal(projected.z);
  const float x = projected.x * inv_z;
  const float y = projected.y * inv_z;
  if (!(x >= -0.5f && y >= -0.5f && x < source.width - 0.5f && y < source.height - 0.5f)) return worst;
  // The four pixels that hold the nearest one: interpolation would invent depths at edges. Truncation is rounding here,
  // as neither is below -0.5; a sum that rounds up to the width or height belongs to the last pixel.
  const ImageView<const uint16_t>& inverse = source.depth.inverse;
  int halved_col = static_cast<int>(x + 0.5f) / 2;  // NOLINT(bugprone-incorrect-roundings)
  int halved_row = static_cast<int>(y + 0.5f) / 2;  // NOLINT(bugprone-incorrect-roundings)
  if (halved_col >= inverse.width) halved_col = inverse.width - 1;
  if (halved_row >= inverse.height) halved_row = inverse.height - 1;
  const auto steps = static_cast<float>(inverse(halved_col, halved_row));
  if (!(steps > 0)) return worst;

  // The point over its depth in the source: the same pixel, and the same sign of z.
  const Vec3f back = source.back_a * Vec3f{x, y, 1.0f} + (source.depth.step * steps) * source.back_b;
  if (!(back.z > 0)) return worst;
  const float inv_back_z = Reciprocal(back.z);
  const float dx = back.x * inv_back_z - pixel.x;
  const float dy = back.y * inv_back_z - pixel.y;
  const float error = sqrtf(dx * dx + dy * dy);
  return error < worst ? error : worst;
}

}  // namespace acmp
