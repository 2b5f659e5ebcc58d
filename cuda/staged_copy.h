#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <vector>

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
  /// What is copied at a time, and what reads it in page-locked memory.
  struct Block {
    const void* from;
    size_t bytes;
    std::function<void(const void* staged)> consume;
  };

  /// Adds all blocks of the first `count` elements: consume(begin, block, size).
  template <class T, class Consume>
  static void AddBlocks(const DeviceArray<T>& from, size_t count, const Consume& consume, std::vector<Block>* blocks) {
    constexpr size_t kMost = kBlockBytes / sizeof(T);
    for (size_t begin = 0; begin < count; begin += kMost) {
      const size_t size = std::min(kMost, count - begin);
      blocks->push_back({from.data() + begin, size * sizeof(T), [consume, begin, size](const void* staged) {
                           consume(begin, static_cast<const T*>(staged), size);
                         }});
    }
  }

  /// One block after the other.
  void Run(const std::vector<Block>& blocks, const CudaStream& stream) {
    char* staged = staging_.Reserve<char>(2 * kBlockBytes);
    for (size_t k = 0; k <= blocks.size(); ++k) {
      if (k < blocks.size()) {
        CudaCheck(cudaMemcpyAsync(staged + k % 2 * kBlockBytes, blocks[k].from, blocks[k].bytes, cudaMemcpyDeviceToHost,
                                  stream.get()),
                  "download");
        filled_[k % 2].Record(stream);
      }
      if (k > 0) {
        filled_[(k - 1) % 2].Wait();
        blocks[k - 1].consume(staged + (k - 1) % 2 * kBlockBytes);
      }
    }
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
    constexpr size_t kLeastPart = 1 << 17, kMostParts = 16;  // fewer pixels leave a large GPU half empty
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
