#pragma once

#include <cuda_runtime_api.h>

#include "cuda_resources.h"

namespace acmp {

constexpr int kBlockWidth = 32;  ///< threads of a warp
constexpr int kBlockHeight = 4;

inline int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

template <class Function>
__global__ void PixelKernel(const __grid_constant__ Function function, int width, int height) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * blockDim.y + threadIdx.y);
  if (col < width && row < height) function(col, row);
}

template <class Function>
__global__ void WarpKernel(const __grid_constant__ Function function, int height) {
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (row < height) function(static_cast<int>(blockIdx.x), row);
}

/// Queues function(col, row), a device lambda, in one thread for each pixel or cell.
/// @param what for the message of an error
template <class Function>
void LaunchForEach(const char* what, int width, int height, cudaStream_t stream, const Function& function,
                   int block_height = kBlockHeight) {
  const dim3 grid(DivideUp(width, kBlockWidth), DivideUp(height, block_height));
  PixelKernel<<<grid, dim3(kBlockWidth, block_height), 0, stream>>>(function, width, height);
  CudaCheck(cudaGetLastError(), what);
}

/// The same in one warp for each cell.
template <class Function>
void LaunchWarpForEach(const char* what, int width, int height, cudaStream_t stream, const Function& function) {
  const dim3 grid(width, DivideUp(height, kBlockHeight));
  WarpKernel<<<grid, dim3(kBlockWidth, kBlockHeight), 0, stream>>>(function, height);
  CudaCheck(cudaGetLastError(), what);
}

}  // namespace acmp
