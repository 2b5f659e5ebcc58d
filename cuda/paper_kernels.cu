#include "group_kernels.h"

namespace acmp {
namespace {

template <Pass kPass, Method kMethod>
__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    InitializeKernel(const __grid_constant__ MatchContext<MaskedTextureSampler> context, int scratch_words, int color) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  const int col = ColOfGroup(place, color);
  if (col >= context.width || place.row >= context.height) return;
  InitializePixel<kPass, kMethod>(context, col, place.row, PixelThreads(), place.scratch);
}

__global__ void __launch_bounds__(kBlockThreads, kBlocksPerMultiprocessor)
    RestoreKernel(const __grid_constant__ MatchContext<MaskedTextureSampler> context, const CoarserEstimate coarser,
                  int scratch_words, int color) {
  const GroupPlace place = PlaceOfGroup(scratch_words);
  const int col = ColOfGroup(place, color);
  if (col >= context.width || place.row >= context.height) return;
  RestorePixel(context, coarser, col, place.row, PixelThreads(), place.scratch);
}

}  // namespace

template <Pass kPass, Method kMethod>
void LaunchPass(const CudaMatchContext& unmasked, int iterations, cudaStream_t stream) {
  static_assert(kMethod != Method::kOurs, "ours are in patch_match_kernels.cu");
  // One kind of kernels for images with and without masks: these are for comparison.
  const MatchContext<MaskedTextureSampler> context = WithMasks(unmasked);
  const GroupGrid grid(context);
  for (int color = 0; color < 2; ++color) {
    InitializeKernel<kPass, kMethod>
        <<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, grid.scratch_words, color);
    CudaCheck(cudaGetLastError(), "launch initialisation");
  }
  LaunchIterations<kPass, kMethod>(context, grid, iterations, stream);
}

void LaunchRestoreDetails(const CudaMatchContext& unmasked, const CoarserEstimate& coarser, cudaStream_t stream) {
  const MatchContext<MaskedTextureSampler> context = WithMasks(unmasked);
  const GroupGrid grid(context);
  for (int color = 0; color < 2; ++color) {
    RestoreKernel<<<grid.blocks, kBlockThreads, grid.bytes, stream>>>(context, coarser, grid.scratch_words, color);
    CudaCheck(cudaGetLastError(), "launch detail restorer");
  }
}

template void LaunchPass<Pass::kPhotometric, Method::kAcmh>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kPlanarPrior, Method::kAcmp>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kAcmh>(const CudaMatchContext&, int, cudaStream_t);
template void LaunchPass<Pass::kGeometric, Method::kAcmp>(const CudaMatchContext&, int, cudaStream_t);

}  // namespace acmp
