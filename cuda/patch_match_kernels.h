#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// Grey values through hardware-filtered textures. The filter's fractions have 8 bits, so values differ from exact
/// interpolation by up to 1/512 of the step between neighbouring pixels.
struct TextureSampler {
  ImageView<const float> reference;
  const cudaTextureObject_t* sources;

  ACMP_HOST_DEVICE float Reference(int col, int row) const { return reference(col, row); }
#ifdef __CUDA_ARCH__
  __device__ float Source(int view, float x, float y) const { return tex2D<float>(sources[view], x + 0.5f, y + 0.5f); }
#else
  float Source(int, float, float) const { return 0; }  // never run: textures can be read on the device only
#endif
};

using CudaMatchContext = MatchContext<TextureSampler>;

/// Queue one pass (initialisation, `iterations` checkerboard iterations, median filter) on the stream. All pointers in
/// the context are device memory.
template <Pass kPass>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream);

/// Asks the driver to load the kernels: fails when the build holds no code for the current device.
cudaError_t ProbeKernels();

}  // namespace acmp
