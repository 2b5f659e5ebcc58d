#include "cuda_check.h"
#include "texture_rate.h"

namespace acmp {
namespace {

/// Each thread fetches along a slanted line near its own pixel, as a warped window does: neighbouring threads share
/// cache lines, so the filter units and not memory are the limit. The sum is written so that nothing is optimised away.
__global__ void FetchKernel(cudaTextureObject_t texture, int layer, int width, int fetches, float* sums) {
  const int index = blockIdx.x * blockDim.x + threadIdx.x;
  float x = static_cast<float>(index % width) + 0.3f;
  float y = static_cast<float>(index / width) + 0.6f;
  float sum = 0;
#pragma unroll 8
  for (int i = 0; i < fetches; ++i) {
    sum += tex2DLayered<float>(texture, x, y, layer);
    x += 0.37f;
    y += 0.11f;
  }
  sums[index] = sum;
}

}  // namespace

void LaunchFetches(cudaTextureObject_t texture, int layer, int width, int height, int fetches, float* sums,
                   cudaStream_t stream) {
  constexpr int kBlock = 256;
  FetchKernel<<<width * height / kBlock, kBlock, 0, stream>>>(texture, layer, width, fetches, sums);
  CudaCheck(cudaGetLastError(), "launch texture fetches");
}

}  // namespace acmp
