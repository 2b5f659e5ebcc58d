#include "texture_fill.h"

#include "cuda_check.h"

namespace acmp {
namespace {

constexpr int kBlockWidth = 32;
constexpr int kBlockHeight = 8;

__global__ void FillLayerKernel(const ImageView<const float> image, cudaSurfaceObject_t surface, int width, int height,
                                int layer) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (col >= width || row >= height) return;
  const float gray = image(min(col, image.width - 1), min(row, image.height - 1));
  const auto texel = static_cast<unsigned short>(__float2uint_rn(65535.0f * __saturatef(gray / 255.0f)));
  surf2DLayeredwrite(texel, surface, col * static_cast<int>(sizeof(texel)), row, layer);
}

}  // namespace

void LaunchFillLayer(const ImageView<const float>& image, cudaSurfaceObject_t surface, int width, int height, int layer,
                     cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 grid((width + kBlockWidth - 1) / kBlockWidth, (height + kBlockHeight - 1) / kBlockHeight);
  FillLayerKernel<<<grid, block, 0, stream>>>(image, surface, width, height, layer);
  CudaCheck(cudaGetLastError(), "launch texture fill");
}

}  // namespace acmp
