#include "texture_fill.h"

#include "cuda_check.h"

namespace acmp {
namespace {

constexpr int kBlockWidth = 32;
constexpr int kBlockHeight = 8;

/// With scale 2 the position is the corner that four pixels share: the filter gives their mean.
__global__ void FillLayerKernel(cudaTextureObject_t source, int source_layer, float scale,
                                cudaSurfaceObject_t destination, LayerImage image, int layer_width, int layer_height) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (col >= layer_width || row >= layer_height) return;
  const float x = scale * (static_cast<float>(min(col, image.width - 1)) + 0.5f);
  const float y = scale * (static_cast<float>(min(row, image.height - 1)) + 0.5f);
  const float value = tex2DLayered<float>(source, x, y, source_layer);
  const auto texel = static_cast<unsigned short>(__float2uint_rn(65535.0f * __saturatef(value)));
  surf2DLayeredwrite(texel, destination, col * static_cast<int>(sizeof(texel)), row, image.layer);
}

}  // namespace

void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 grid((layer_width + kBlockWidth - 1) / kBlockWidth, (layer_height + kBlockHeight - 1) / kBlockHeight);
  FillLayerKernel<<<grid, block, 0, stream>>>(source, source_layer, scale, destination, image, layer_width,
                                              layer_height);
  CudaCheck(cudaGetLastError(), "launch texture fill");
}

}  // namespace acmp
