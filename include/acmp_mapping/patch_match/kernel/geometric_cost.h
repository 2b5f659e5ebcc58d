#pragma once

#include <cstdint>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

constexpr float kInverseSteps = 65535.0f;

/// Width or height of the halved map; an odd last row or column has a pixel of its own.
ACMP_HOST_DEVICE inline int HalvedSize(int size) { return (size + 1) / 2; }

/// 1 / z, or 0 where the depth is unknown or has no inverse in float.
ACMP_HOST_DEVICE inline float InverseOfDepth(float depth) {
  constexpr float kLargestInverse = 1e30f;
  const float inverse = depth > 0 ? 1.0f / depth : 0.0f;
  return inverse <= kLargestInverse ? inverse : 0.0f;
}

/// The inverse depth of pixel (col, row) of the halved map: the mean where the known ones of the four agree, else the
/// mean of the two that lie closest together, as a mean across a depth edge would lie on neither side; of only two the
/// nearer, which hides the other. 0: none is known.
ACMP_HOST_DEVICE inline float HalvedInverseDepth(const ImageView<const float>& depth, int col, int row) {
  constexpr float kAgreement = 0.02f;  // relative: a surface seen at 82 degrees from its normal with f = 500 px
  constexpr int kPixels = 4;
  float sorted[kPixels];
  int count = 0;
  for (int i = 0; i < kPixels; ++i) {
    const int c = 2 * col + i % 2, r = 2 * row + i / 2;
    if (!depth.Contains(c, r)) continue;
    const float inverse = InverseOfDepth(depth(c, r));
    if (!(inverse > 0)) continue;
    int slot = count++;
    for (; slot > 0 && inverse < sorted[slot - 1]; --slot) sorted[slot] = sorted[slot - 1];
    sorted[slot] = inverse;
  }
  if (count == 0) return 0;
  if (count == 1 || sorted[count - 1] - sorted[0] <= kAgreement * sorted[0]) {
    float sum = 0;
    for (int i = 0; i < count; ++i) sum += sorted[i];
    return sum / static_cast<float>(count);
  }
  if (count == 2) return sorted[1];
  int closest = 0;
  for (int i = 1; i + 1 < count; ++i) {
    if (sorted[i + 1] - sorted[i] < sorted[closest + 1] - sorted[closest]) closest = i;
  }
  return 0.5f * (sorted[closest] + sorted[closest + 1]);
}

/// An inverse depth in steps; only what is not known gives 0, so that the farthest points stay known.
ACMP_HOST_DEVICE inline uint16_t StepsOfInverse(float inverse, float step) {
  if (!(inverse > 0)) return 0;
  const float steps = inverse / step + 0.5f;
  return static_cast<uint16_t>(steps < 1 ? 1.0f : steps < kInverseSteps ? steps : kInverseSteps);
}

/// Inverse depth that a halved map has at a position of the image: interpolated where the four around it are of one
/// surface, since on a floor that is seen at a slant the nearest alone is off by percents; else the nearest, as
/// interpolation would invent depths at edges. 0: unknown.
ACMP_HOST_DEVICE inline float InverseAt(const HalvedDepth& depth, float x, float y) {
  constexpr float kSameSurface = 1.05f;
  const auto clamped = [](int value, int last) { return value < 0 ? 0 : value > last ? last : value; };
  const int last_col = depth.inverse.width - 1, last_row = depth.inverse.height - 1;
  // The halved map's pixels are 2 px wide. One more and one less, as truncation rounds up below 0.
  const float col = 0.5f * x - 0.25f, row = 0.5f * y - 0.25f;
  const int left = static_cast<int>(col + 1) - 1, top = static_cast<int>(row + 1) - 1;
  const float right_share = col - static_cast<float>(left), bottom_share = row - static_cast<float>(top);
  const int c0 = clamped(left, last_col), c1 = clamped(left + 1, last_col);
  const int r0 = clamped(top, last_row), r1 = clamped(top + 1, last_row);
  const float a = depth.inverse(c0, r0), b = depth.inverse(c1, r0);
  const float c = depth.inverse(c0, r1), d = depth.inverse(c1, r1);
  const float least = fminf(fminf(a, b), fminf(c, d)), greatest = fmaxf(fmaxf(a, b), fmaxf(c, d));
  const float upper = a + right_share * (b - a), lower = c + right_share * (d - c);
  const float nearest = bottom_share < 0.5f ? (right_share < 0.5f ? a : b) : (right_share < 0.5f ? c : d);
  return depth.step * (greatest <= kSameSurface * least ? upper + bottom_share * (lower - upper) : nearest);
}

/// Inverse depth of a source at a position inside its image. 0: unknown. Ours reads the halved map, the papers' the
/// nearest pixel.
template <Method kMethod, class Sampler>
ACMP_HOST_DEVICE inline float InverseSourceDepth(const MatchContext<Sampler>& context, int view, float x, float y) {
  if constexpr (kMethod == Method::kOurs) {
    return InverseAt(context.sources[view].depth, x, y);
  } else {
    // Truncation is rounding here, as neither is below -0.5; a sum that rounds up to the width or height belongs to the
    // last pixel.
    int col = static_cast<int>(x + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
    int row = static_cast<int>(y + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
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
