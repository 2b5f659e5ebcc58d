#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/common/host_device.h"
#include "cuda_resources.h"

namespace acmp {

/// A thread group (see SingleThread) of neighbouring threads of a warp: `kThreads` of them, a power of two, from a
/// multiple of it on. Blocks have one dimension, or rows of whole warps. All threads of a group call its methods
/// together.
template <int kThreads>
struct WarpGroup {
  static constexpr int kSize = kThreads;
  static_assert(kThreads >= 1 && kThreads <= 32 && (kThreads & (kThreads - 1)) == 0, "part of a warp");

  __device__ int Rank() const { return static_cast<int>(threadIdx.x % kThreads); }

  __device__ void Sync() const { __syncwarp(Lanes()); }
  __device__ void Increment(int* counter) const { atomicAdd(counter, 1); }
  __device__ bool Any(bool x) const { return __any_sync(Lanes(), x) != 0; }

  /// The group's lanes of the warp, as bits.
  static __device__ unsigned Lanes() {
    return (0xffffffffu >> (32 - kThreads)) << (threadIdx.x % 32u / kThreads * kThreads);
  }
  /// The value of the thread whose rank differs in this bit.
  template <class T>
  static __device__ T Across(int bit, T x) {
    return __shfl_xor_sync(Lanes(), x, bit);
  }
  /// All threads' values merged by a commutative function, to the same bits in all of them.
  template <class T, class Merge>
  static __device__ T Merged(T x, const Merge& merge) {
    ACMP_UNROLL
    for (int bit = 1; bit < kThreads; bit *= 2) x = merge(x, Across(bit, x));
    return x;
  }
  template <class T>
  static __device__ T Sum(T x) {
    return Merged(x, [](T a, T b) { return a + b; });
  }
  template <class T>
  static __device__ T Least(T x) {
    return Merged(x, [](T a, T b) { return b < a ? b : a; });
  }
  template <class T>
  static __device__ T Greatest(T x) {
    return Merged(x, [](T a, T b) { return a < b ? b : a; });
  }
  static __device__ unsigned Union(unsigned bits) {
    return Merged(bits, [](unsigned a, unsigned b) { return a | b; });
  }
  /// The value of the thread with this rank.
  template <class T>
  static __device__ T From(int rank, T x) {
    return __shfl_sync(Lanes(), x, rank, kThreads);
  }
  template <class T>
  static __device__ T FromFirst(T x) {
    return From(0, x);
  }
};

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
