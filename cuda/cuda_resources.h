#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "multiprocessor_share.h"

namespace acmp {

/// Throws ProcessingError "what: CUDA's own text" unless `status` is cudaSuccess.
void CudaCheck(cudaError_t status, const char* what);

/// Owns a non-blocking stream. Nothing of ours runs on the default stream.
class CudaStream {
 public:
  /// @param share whose multiprocessors do what is queued; null: all of the selected device
  explicit CudaStream(const MultiprocessorShare* share = nullptr);
  ~CudaStream();
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;

  cudaStream_t get() const { return stream_; }
  void Synchronize() const;

 private:
  cudaStream_t stream_ = nullptr;
};

/// Owns an event that keeps time.
class CudaEvent {
 public:
  CudaEvent();
  ~CudaEvent();
  CudaEvent(const CudaEvent&) = delete;
  CudaEvent& operator=(const CudaEvent&) = delete;

  void Record(const CudaStream& stream) const;
  /// Until what was queued before the event is done.
  void Wait() const;
  /// Milliseconds between two recorded and reached events.
  static double ElapsedMs(const CudaEvent& start, const CudaEvent& end);

 private:
  cudaEvent_t event_ = nullptr;
};

/// Owns page-locked host memory, which copies run at full speed from and to. It only grows.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  ~PinnedBuffer();
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  /// At least `count` elements, contents undefined. What was copied from or to it before must have been waited for.
  template <class T>
  T* Reserve(size_t count) {
    return static_cast<T*>(ReserveBytes(count * sizeof(T)));
  }

 private:
  void* ReserveBytes(size_t bytes);

  void* data_ = nullptr;
  size_t capacity_ = 0;
};

}  // namespace acmp
