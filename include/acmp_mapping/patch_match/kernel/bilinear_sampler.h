#pragma once

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {

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

/// Sampler over images in plain memory, with explicit interpolation: the CPU's, and the GPU's when it is compared.
struct BilinearSampler {
  ImageView<const float> reference;
  const ImageView<const float>* sources;

  ACMP_HOST_DEVICE float Reference(int col, int row) const { return reference(col, row); }
  static constexpr float kPixelCenter = 0.0f;
  ACMP_HOST_DEVICE int ImageOf(int view) const { return view; }
  ACMP_HOST_DEVICE float SourceAt(int image, float x, float y) const { return SampleBilinear(sources[image], x, y); }
};

/// Offsets of the samples from the centre, px: from a table the compiler can load several at once.
struct WindowOffsets {
  float col[kPatchSamples];
  float row[kPatchSamples];
};

constexpr WindowOffsets MakeWindowOffsets() {
  WindowOffsets offsets = {};
  for (int i = 0; i < kPatchSamples; ++i) {
    offsets.col[i] = static_cast<float>(WindowCol(i));
    offsets.row[i] = static_cast<float>(WindowRow(i));
  }
  return offsets;
}

/// The same values for a whole window in three loops, of which a compiler vectorises the first and the last.
template <class Function>
ACMP_HOST_DEVICE inline void ForEachWindowSample(const BilinearSampler& sampler, int source, const PlaneWarp& warp,
                                                 const Function& function) {
  static constexpr WindowOffsets kWindowOffsets = MakeWindowOffsets();
  const ImageView<const float> image = sampler.sources[source];
  if (image.width < 2 || image.height < 2) {
    ForEachWindowSample<BilinearSampler, Function>(sampler, source, warp, function);
    return;
  }
  const float max_x = static_cast<float>(image.width - 1), max_y = static_cast<float>(image.height - 1);
  int offset[kPatchSamples];
  float fx[kPatchSamples], fy[kPatchSamples];
  for (int i = 0; i < kPatchSamples; ++i) {
    const float dx = kWindowOffsets.col[i], dy = kWindowOffsets.row[i];
    const float inv_z = 1.0f / (warp.center.z + dx * warp.step_col.z + dy * warp.step_row.z);
    const float x = Clamp((warp.center.x + dx * warp.step_col.x + dy * warp.step_row.x) * inv_z, 0.0f, max_x);
    const float y = Clamp((warp.center.y + dx * warp.step_col.y + dy * warp.step_row.y) * inv_z, 0.0f, max_y);
    // The cell's upper left pixel: on the last column and row the fraction is 1 instead.
    const int x0 = static_cast<int>(x) < image.width - 2 ? static_cast<int>(x) : image.width - 2;
    const int y0 = static_cast<int>(y) < image.height - 2 ? static_cast<int>(y) : image.height - 2;
    fx[i] = x - static_cast<float>(x0);
    fy[i] = y - static_cast<float>(y0);
    offset[i] = y0 * image.stride + x0;
  }
  float a[kPatchSamples], b[kPatchSamples], c[kPatchSamples], d[kPatchSamples];
  for (int i = 0; i < kPatchSamples; ++i) {
    const float* cell = image.data + offset[i];
    a[i] = cell[0];
    b[i] = cell[1];
    c[i] = cell[image.stride];
    d[i] = cell[image.stride + 1];
  }
  float value[kPatchSamples];
  for (int i = 0; i < kPatchSamples; ++i) {
    const float top = a[i] + fx[i] * (b[i] - a[i]);
    const float bottom = c[i] + fx[i] * (d[i] - c[i]);
    value[i] = top + fy[i] * (bottom - top);
  }
  for (int i = 0; i < kPatchSamples; ++i) function(i, value[i]);
}

}  // namespace acmp
