#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "acmp_mapping/common/error.h"

namespace acmp {

/// Throws ProcessingError "what: CUDA's own text" unless `status` is cudaSuccess.
inline void CudaCheck(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw ProcessingError(Concat(what, ": ", cudaGetErrorString(status), " (", cudaGetErrorName(status), ")"));
}

/// Owns a non-blocking stream. Nothing of ours runs on the default stream.
class CudaStream {
 public:
  CudaStream() { CudaCheck(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "create stream"); }
  // Destructors cannot report; after a device failure there is nothing left to release.
  ~CudaStream() { cudaStreamDestroy(stream_); }
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;

  cudaStream_t get() const { return stream_; }
  void Synchronize() const { CudaCheck(cudaStreamSynchronize(stream_), "run kernels"); }

 private:
  cudaStream_t stream_ = nullptr;
};

/// Owns an event that keeps time.
class CudaEvent {
 public:
  CudaEvent() { CudaCheck(cudaEventCreate(&event_), "create event"); }
  ~CudaEvent() { cudaEventDestroy(event_); }
  CudaEvent(const CudaEvent&) = delete;
  CudaEvent& operator=(const CudaEvent&) = delete;

  void Record(const CudaStream& stream) const { CudaCheck(cudaEventRecord(event_, stream.get()), "record event"); }
  /// Until what was queued before the event is done.
  void Wait() const { CudaCheck(cudaEventSynchronize(event_), "run kernels"); }
  /// Milliseconds between two recorded and reached events.
  static double ElapsedMs(const CudaEvent& start, const CudaEvent& end) {
    float ms = 0;
    CudaCheck(cudaEventElapsedTime(&ms, start.event_, end.event_), "read event");
    return ms;
  }

 private:
  cudaEvent_t event_ = nullptr;
};

/// Owns page-locked host memory, which copies run at full speed from and to. It only grows.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  ~PinnedBuffer() { cudaFreeHost(data_); }
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  /// At least `count` elements, contents undefined. What was copied from or to it before must have been waited for.
  template <class T>
  T* Reserve(size_t count) {
    return static_cast<T*>(ReserveBytes(count * sizeof(T)));
  }

 private:
  void* ReserveBytes(size_t bytes) {
    if (bytes <= capacity_) return data_;
    cudaFreeHost(data_);
    data_ = nullptr;
    capacity_ = 0;
    const cudaError_t status = cudaHostAlloc(&data_, bytes, cudaHostAllocDefault);
    if (status != cudaSuccess) {
      cudaGetLastError();  // out of memory is not sticky: the device stays usable
      data_ = nullptr;
      CudaCheck(status, Concat("allocate ", bytes, " bytes of page-locked memory").c_str());
    }
    capacity_ = bytes;
    return data_;
  }

  void* data_ = nullptr;
  size_t capacity_ = 0;
};

}  // namespace acmp
