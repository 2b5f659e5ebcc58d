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

/// Sampler over images in plain memory, with explicit interpolation. The CPU's is derived from it (window_sums.h); the
/// GPU uses it where the two are compared.
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
