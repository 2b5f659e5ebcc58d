#pragma once

#include "acmp_mapping/common/host_device.h"
#include "acmp_mapping/common/vector_math.h"

namespace acmp {

constexpr int kPatchRadius = 5;  ///< 11 x 11 px window ...
constexpr int kPatchStep = 2;    ///< ... at every second pixel
constexpr int kPatchWidth = kPatchRadius * 2 / kPatchStep + 1;
constexpr int kPatchSamples = kPatchWidth * kPatchWidth;  ///< 36

/// Homography from reference to source pixels induced by a plane, as the projections of the centre pixel and of a step
/// of one pixel along each axis (third component: depth in the source over depth in the reference).
struct PlaneWarp {
  Vec3f center, step_col, step_row;
};

/// Column and row of window sample `i` from the centre, px.
ACMP_HOST_DEVICE constexpr int WindowCol(int i) { return (i % kPatchWidth) * kPatchStep - kPatchRadius; }
ACMP_HOST_DEVICE constexpr int WindowRow(int i) { return (i / kPatchWidth) * kPatchStep - kPatchRadius; }

/// Calls function(i, grey value) for the source pixels that the warp gives the window's samples, in order. Samplers may
/// overload it with a faster way to the same values.
template <class Sampler, class Function>
ACMP_HOST_DEVICE inline void ForEachWindowSample(const Sampler& sampler, int view, const PlaneWarp& warp,
                                                 const Function& function) {
  ACMP_UNROLL
  for (int i = 0; i < kPatchSamples; ++i) {
    const float dx = static_cast<float>(WindowCol(i));
    const float dy = static_cast<float>(WindowRow(i));
    const float inv_z = Reciprocal(warp.center.z + dx * warp.step_col.z + dy * warp.step_row.z);
    const float x = (warp.center.x + dx * warp.step_col.x + dy * warp.step_row.x) * inv_z;
    const float y = (warp.center.y + dx * warp.step_col.y + dy * warp.step_row.y) * inv_z;
    function(i, sampler.Source(view, x, y));
  }
}

}  // namespace acmp
