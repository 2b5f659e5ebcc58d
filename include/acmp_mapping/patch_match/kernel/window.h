#pragma once

#include "acmp_mapping/common/host_device.h"
#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/image/image.h"

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

/// Samples come in nine blocks of 2 x 2: four threads that take one of each block read source pixels side by side,
/// which a texture unit does at once.
constexpr int kBlockSamples = 4;
constexpr int kBlocksPerRow = kPatchWidth / 2;
constexpr int kNumBlocks = kPatchSamples / kBlockSamples;

/// Column and row of window sample `i` from the centre, px.
ACMP_HOST_DEVICE constexpr int WindowCol(int i) {
  return (i / kBlockSamples % kBlocksPerRow * 2 + i % 2) * kPatchStep - kPatchRadius;
}
ACMP_HOST_DEVICE constexpr int WindowRow(int i) {
  return (i / kBlockSamples / kBlocksPerRow * 2 + i % kBlockSamples / 2) * kPatchStep - kPatchRadius;
}

/// Calls function(block, grey value) for sample `part` of every block, in order.
template <class Sampler, class Function>
ACMP_HOST_DEVICE inline void ForEachSampleOfPart(const Sampler& sampler, int image, const PlaneWarp& warp, int part,
                                                 const Function& function) {
  constexpr float kBlockStep = 2 * kPatchStep;
  const auto shifted = [](const Vec3f& v) {
    return Vec3f{v.x + Sampler::kPixelCenter * v.z, v.y + Sampler::kPixelCenter * v.z, v.z};
  };
  const Vec3f step_col = shifted(warp.step_col), step_row = shifted(warp.step_row);
  const Vec3f first = shifted(warp.center) + static_cast<float>(WindowCol(part)) * step_col +
                      static_cast<float>(WindowRow(part)) * step_row;
  ACMP_UNROLL
  for (int block = 0; block < kNumBlocks; ++block) {
    const int block_col = block % kBlocksPerRow, block_row = block / kBlocksPerRow;
    const float dx = kBlockStep * static_cast<float>(block_col);
    const float dy = kBlockStep * static_cast<float>(block_row);
    const float inv_z = Reciprocal(first.z + dy * step_row.z + dx * step_col.z);
    const float x = (first.x + dy * step_row.x + dx * step_col.x) * inv_z;
    const float y = (first.y + dy * step_row.y + dx * step_col.y) * inv_z;
    function(block, sampler.SourceAt(image, x, y));
  }
}

/// Calls function(i, grey value) for the source pixels that the warp gives the window's samples, in order.
template <class Sampler, class Function>
ACMP_HOST_DEVICE inline void ForEachWindowSample(const Sampler& sampler, int image, const PlaneWarp& warp,
                                                 const Function& function) {
  for (int i = 0; i < kPatchSamples; ++i) {
    const float dx = static_cast<float>(WindowCol(i));
    const float dy = static_cast<float>(WindowRow(i));
    const float inv_z = Reciprocal(warp.center.z + dx * warp.step_col.z + dy * warp.step_row.z);
    const float x = (warp.center.x + dx * warp.step_col.x + dy * warp.step_row.x) * inv_z;
    const float y = (warp.center.y + dx * warp.step_col.y + dy * warp.step_row.y) * inv_z;
    function(i, sampler.SourceAt(image, x + Sampler::kPixelCenter, y + Sampler::kPixelCenter));
  }
}

/// Bilinear value at a real position, clamped to the border; NaN positions read column or row 0.
ACMP_HOST_DEVICE inline float SampleBilinear(const ImageView<const float>& image, float x, float y) {
  const float xc = Clamp(x, 0.0f, static_cast<float>(image.width - 1));
  const float yc = Clamp(y, 0.0f, static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(xc);
  const int y0 = static_cast<int>(yc);
  const int x1 = x0 + 1 < image.width ? x0 + 1 : x0;
  const int y1 = y0 + 1 < image.height ? y0 + 1 : y0;
  const float fx = xc - static_cast<float>(x0);
  const float fy = yc - static_cast<float>(y0);
  const float* row0 = image.data + static_cast<size_t>(y0) * image.stride;
  const float* row1 = image.data + static_cast<size_t>(y1) * image.stride;
  const float top = row0[x0] + fx * (row0[x1] - row0[x0]);
  const float bottom = row1[x0] + fx * (row1[x1] - row1[x0]);
  return top + fy * (bottom - top);
}

/// Sampler over images in plain memory, with explicit interpolation. The CPU's is derived from it (host_functions.h).
struct BilinearSampler {
  ImageView<const float> reference;
  const ImageView<const float>* sources;

  ACMP_HOST_DEVICE float Reference(int col, int row) const { return reference(col, row); }
  static constexpr float kPixelCenter = 0.0f;
  static constexpr bool kHasMasks = true;
  ACMP_HOST_DEVICE int ImageOf(int view) const { return view; }
  ACMP_HOST_DEVICE float SourceAt(int image, float x, float y) const { return SampleBilinear(sources[image], x, y); }
};

}  // namespace acmp
