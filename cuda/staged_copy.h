#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>

#include "cuda_device.h"

namespace acmp {

/// `count` elements from page-locked memory, by all threads: a single one is slower than the bus.
template <class T>
void ParallelCopy(const T* from, size_t count, T* to) {
  constexpr size_t kPart = 1 << 16;
  tbb::parallel_for(size_t{0}, (count + kPart - 1) / kPart, [&](size_t part) {
    const size_t begin = part * kPart;
    std::copy(from + begin, from + std::min(count, begin + kPart), to + begin);
  });
}

/// Copies from device memory through two blocks of page-locked memory: while one is filled the other is read, so that
/// large maps need neither much page-locked memory nor the time to allocate it.
class StagedDownload {
 public:
  /// consume(begin, block, size) for all blocks of the first `count` elements, in order.
  template <class T, class Consume>
  void Run(const DeviceArray<T>& from, size_t count, const CudaStream& stream, const Consume& consume) {
    const size_t block = kBlockBytes / sizeof(T);
    const size_t blocks = (count + block - 1) / block;
    T* staged = staging_.Reserve<T>(2 * block);
    for (size_t k = 0; k <= blocks; ++k) {
      if (k < blocks) {
        const size_t size = std::min(block, count - k * block);
        CudaCheck(cudaMemcpyAsync(staged + k % 2 * block, from.data() + k * block, size * sizeof(T),
                                  cudaMemcpyDeviceToHost, stream.get()),
                  "download");
        filled_[k % 2].Record(stream);
      }
      if (k > 0) {
        filled_[(k - 1) % 2].Wait();
        const size_t begin = (k - 1) * block;
        consume(begin, staged + (k - 1) % 2 * block, std::min(block, count - begin));
      }
    }
  }

  template <class T>
  void Run(const DeviceArray<T>& from, size_t count, const CudaStream& stream, T* to) {
    Run(from, count, stream, [&](size_t begin, const T* block, size_t size) { ParallelCopy(block, size, to + begin); });
  }

 private:
  static constexpr size_t kBlockBytes = 8 << 20;

  PinnedBuffer staging_;
  CudaEvent filled_[2];
};

}  // namespace acmp
