#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <vector>

#include "acmp_mapping/image/image.h"
#include "cuda_check.h"

namespace acmp {

/// Owns a non-blocking stream. Nothing of ours runs on the default stream.
class CudaStream {
 public:
  CudaStream();
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
  /// Milliseconds between two recorded and reached events.
  static double ElapsedMs(const CudaEvent& start, const CudaEvent& end);

 private:
  cudaEvent_t event_ = nullptr;
};

/// Owns device memory that only grows: no allocation once the largest problem has been seen.
class DeviceBytes {
 public:
  DeviceBytes() = default;
  ~DeviceBytes();
  DeviceBytes(const DeviceBytes&) = delete;
  DeviceBytes& operator=(const DeviceBytes&) = delete;

  /// At least `bytes` bytes, contents undefined. Throws ProcessingError naming the size when memory runs out; the
  /// buffer is then empty.
  void* Reserve(size_t bytes);

 private:
  void* data_ = nullptr;
  size_t capacity_ = 0;
};

template <class T>
class DeviceBuffer {
 public:
  void Resize(size_t count) {
    data_ = static_cast<T*>(bytes_.Reserve(count * sizeof(T)));
    count_ = count;
  }
  T* data() const { return data_; }

  /// Copies `count()` elements; the host side must stay valid until the stream has been synchronised.
  void Upload(const T* host, const CudaStream& stream) {
    CudaCheck(cudaMemcpyAsync(data_, host, count_ * sizeof(T), cudaMemcpyHostToDevice, stream.get()), "upload");
  }
  void Download(T* host, const CudaStream& stream) const {
    CudaCheck(cudaMemcpyAsync(host, data_, count_ * sizeof(T), cudaMemcpyDeviceToHost, stream.get()), "download");
  }

 private:
  DeviceBytes bytes_;
  T* data_ = nullptr;
  size_t count_ = 0;
};

/// Grey levels per unit of what a texture gives.
constexpr float kGrayPerTexel = 255.0f;

/// Owns grey images as the layers of one texture: bilinear, clamped to the border, pixel centres at +0.5. One texture
/// for all, because threads of a warp that read different textures wait for each other. 16 bits hold 1/257 of a grey
/// level and take half the cache of a float. Reallocated only to grow in layers or when the size changes.
class DeviceTexture {
 public:
  DeviceTexture() = default;
  ~DeviceTexture();
  DeviceTexture(const DeviceTexture&) = delete;
  DeviceTexture& operator=(const DeviceTexture&) = delete;

  /// Copies the images (0..255), which must stay valid until the stream has been synchronised. Smaller ones are
  /// continued to the size of the largest by their last column and row, as clamping would.
  void Upload(const std::vector<ImageView<const float>>& images, const CudaStream& stream);
  cudaTextureObject_t get() const { return texture_; }

 private:
  void Release() noexcept;
  void Allocate(int width, int height, int layers);

  cudaArray_t array_ = nullptr;
  cudaTextureObject_t texture_ = 0;
  cudaSurfaceObject_t surface_ = 0;
  int width_ = 0, height_ = 0, layers_ = 0;
  DeviceBuffer<float> staging_;
};

}  // namespace acmp
