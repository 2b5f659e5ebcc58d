#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

/// Whether a window, warped into a source, reaches a pixel that the source's mask ignores. The clearance at its middle
/// is compared with how far it reaches: one look for a whole window. At the same scale windows whose middle is within
/// 6 px of such a pixel do. The middle lies inside the source.
template <class Sampler>
ACMP_HOST_DEVICE inline bool ReachesMasked(const MatchContext<Sampler>& context, int view, const PlaneWarp& warp) {
  constexpr float kInterpolation = 1.5f;  // px, from the pixel nearest to the middle to one that is interpolated
  if (!Sampler::kHasMasks || context.source_clearances == nullptr) return false;
  const ImageView<const unsigned char>& clearance = context.source_clearances[view];
  if (clearance.data == nullptr) return false;
  const float min_z = warp.center.z - kPatchRadius * (fabsf(warp.step_col.z) + fabsf(warp.step_row.z));
  if (!(min_z > 0)) return true;
  const float inv_z = Reciprocal(warp.center.z);
  const float x = warp.center.x * inv_z, y = warp.center.y * inv_z;
  // A sample at offset (i, j) is off the middle by (i dx_i + j dx_j) / z in x, with dx_i = step_col.x - x step_col.z.
  const float across = fabsf(warp.step_col.x - x * warp.step_col.z) + fabsf(warp.step_row.x - x * warp.step_row.z);
  const float along = fabsf(warp.step_col.y - y * warp.step_col.z) + fabsf(warp.step_row.y - y * warp.step_row.z);
  const float reach = kPatchRadius * Reciprocal(min_z) * (across > along ? across : along);
  const auto nearest = [](float position, int size) {
    const float clamped = Clamp(position, 0.0f, static_cast<float>(size - 1));
    return static_cast<int>(clamped + 0.5f);  // NOLINT(bugprone-incorrect-roundings): nothing is negative
  };
  return static_cast<float>(clearance(nearest(x, clearance.width), nearest(y, clearance.height))) <
         reach + kInterpolation;
}

/// True for a pixel of the reference that its mask ignores: it has no hypothesis.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline bool LeaveIfMasked(const MatchContext<Sampler>& context, int col, int row, const Group& group) {
  if (!context.IsMasked(col, row)) return false;
  if (group.Rank() == 0) {
    context.planes(col, row) = {};
    context.cost(col, row) = kWorstCost;
    context.selected_views(col, row) = 0;
  }
  return true;
}

}  // namespace acmp
