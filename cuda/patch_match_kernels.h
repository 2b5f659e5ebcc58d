#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "texture_pool.h"

namespace acmp {

/// Grey values through hardware-filtered textures. The filter's fractions have 8 bits, so values differ from exact
/// interpolation by up to 1/512 of the step between neighbouring pixels, and texels are rounded to 1/257 of a grey
/// level.
struct TextureSampler {
  using Cost = Ncc;
  cudaTextureObject_t images;
  int reference;                ///< layer of the reference
  int layers[kMaxSourceViews];  ///< of each source view

  static constexpr float kPixelCenter = 0.5f;
  static constexpr bool kHasMasks = false;
  /// At a pixel's centre the filter gives its texel as it is.
  ACMP_HOST_DEVICE float Reference(int col, int row) const {
    return SourceAt(reference, static_cast<float>(col) + kPixelCenter, static_cast<float>(row) + kPixelCenter);
  }
  ACMP_HOST_DEVICE int ImageOf(int view) const { return layers[view]; }
#ifdef __CUDA_ARCH__
  __device__ float SourceAt(int image, float x, float y) const {
    return kGrayPerTexel * tex2DLayered<float>(images, x, y, image);
  }
#else
  /// Never run: textures can be read on the device only.
  float SourceAt(int /*image*/, float /*x*/, float /*y*/) const { return 0; }
#endif
};

using CudaMatchContext = MatchContext<TextureSampler>;

/// The same for problems with masks: kernels of their own, since the registers that masks take cost time.
struct MaskedTextureSampler : TextureSampler {
  static constexpr bool kHasMasks = true;
};

inline bool HasMasks(const CudaMatchContext& context) {
  return context.mask_distance.data != nullptr || context.source_mask_distances != nullptr;
}

/// Queue one pass (initialisation, `iterations` checkerboard iterations, our median filter) on the stream. All pointers
/// in the context are device memory.
template <Pass kPass, Method kMethod>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream);

/// Queues RestorePixel for all pixels on the stream. All pointers are device memory.
void LaunchRestoreDetails(const CudaMatchContext& context, const CoarserEstimate& coarser, cudaStream_t stream);

/// Queues EvidenceOfCell for all cells of `cell_size` px on the stream. All pointers are device memory.
void LaunchMeasureEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence,
                           cudaStream_t stream);

/// Asks the driver to load the kernels: fails when the build holds no code for the current device.
cudaError_t ProbeKernels();

}  // namespace acmp
