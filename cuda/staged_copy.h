#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>

#include "cuda_device.h"
#include "kernels.h"

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

/// Fetches points that kernels make of all pixels.
class PointDownload {
 public:
  /// launch(range, output) for all pixels, a part after the other, so that the device needs room for the points of one
  /// part. The host takes those of the part before meanwhile.
  template <class Launch>
  PointCloud Run(const CudaDevicePtr& device, size_t pixels, const CudaStream& stream, const Launch& launch) {
    constexpr size_t kLeastPart = 1 << 15, kMostParts = 16;
    const size_t part = std::max(kLeastPart, (pixels + kMostParts - 1) / kMostParts);
    const size_t parts = (pixels + part - 1) / part;
    of_pixels_.Reserve(device, part);
    accepted_.Reserve(device, part);
    if (points_.size() < part) {
      points_.Reserve(device, part);
      // A part comes to the host as a whole, before its count is known: also what is unset behind that.
      CudaCheck(cudaMemsetAsync(points_.data(), 0, part * sizeof(SurfacePoint), stream.get()), "reset points");
    }
    count_.Reserve(device, 1);
    scratch_.Reserve(device, PointScratchBytes(part));
    const PointOutput output = {of_pixels_.data(), accepted_.data(), points_.data(),
                                count_.data(),     scratch_.data(),  scratch_.size()};
    auto* staged = points_on_host_.Reserve<SurfacePoint>(2 * part);
    auto* counts = counts_on_host_.Reserve<unsigned>(2);
    PointCloud points;
    points.reserve(pixels);
    for (size_t k = 0; k <= parts; ++k) {
      if (k < parts) {
        const PixelRange range = {k * part, std::min(part, pixels - k * part)};
        launch(range, output);
        count_.Download(counts + k % 2, 1, stream);
        points_.Download(staged + k % 2 * part, range.count, stream);
        filled_[k % 2].Record(stream);
      }
      if (k > 0) {
        const size_t before = (k - 1) % 2;
        filled_[before].Wait();
        points.insert(points.end(), staged + before * part, staged + before * part + counts[before]);
      }
    }
    return points;
  }

 private:
  PinnedBuffer points_on_host_, counts_on_host_;
  CudaEvent filled_[2];
  DeviceArray<SurfacePoint> of_pixels_, points_;
  DeviceArray<unsigned char> accepted_, scratch_;
  DeviceArray<unsigned> count_;
};

}  // namespace acmp
