#pragma once

#include <cuda_runtime_api.h>

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "cuda_resources.h"
#include "fair_shared_mutex.h"
#include "texture_pool.h"

namespace acmp {

/// What all that work on one GPU share: its memory and its images. Outlives everything that was made with it.
class CudaDevice {
 public:
  /// Throws InvalidInputError that says what is missing: driver, device, or code for its architecture.
  explicit CudaDevice(int index);
  ~CudaDevice();
  CudaDevice(const CudaDevice&) = delete;
  CudaDevice& operator=(const CudaDevice&) = delete;

  int index() const { return index_; }
  const cudaDeviceProp& properties() const { return properties_; }
  /// Selects the device for the calling thread.
  void MakeCurrent() const;

  /// Device memory from a pool that keeps what is given back: no allocation from the driver once the largest load has
  /// been seen. Throws ProcessingError naming the size when memory runs out.
  void* Allocate(size_t bytes);
  /// All work that uses the memory must have been waited for, or an exception be under way: then it is waited for here.
  void Free(void* data) noexcept;
  /// Bytes of the pool and of the images' textures.
  size_t Bytes() const;

  /// Images halved `level` times.
  TexturePool& images(int level) { return images_[static_cast<size_t>(level)]; }
  /// Held shared by whoever reads or fills images, alone by a pool that grows.
  FairSharedMutex& images_mutex() { return images_mutex_; }

  /// The turn of a pass over so many pixels. A pass that fills the device many times over gains nothing from another
  /// one beside it: both would only end later, and with them the triangulations that wait for them. Small passes, whose
  /// last blocks leave the device half empty, take no turns: the lock is empty.
  std::unique_lock<std::mutex> PassTurn(size_t pixels);

 private:
  const int index_;
  cudaDeviceProp properties_ = {};
  cudaMemPool_t pool_ = nullptr;
  std::unique_ptr<CudaStream> memory_stream_;  ///< on which memory changes hands
  FairSharedMutex images_mutex_;
  std::mutex pass_turn_;
  std::array<TexturePool, 3> images_;
};

using CudaDevicePtr = std::shared_ptr<CudaDevice>;

/// Owns `size()` elements of device memory.
template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  DeviceArray(CudaDevicePtr device, size_t size)
      : device_(std::move(device)), data_(static_cast<T*>(device_->Allocate(size * sizeof(T)))), size_(size) {}
  ~DeviceArray() {
    if (data_ != nullptr) device_->Free(data_);
  }
  DeviceArray(DeviceArray&& other) noexcept { *this = std::move(other); }
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(device_, other.device_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;

  const CudaDevicePtr& device() const { return device_; }
  T* data() const { return data_; }
  size_t size() const { return size_; }

  /// Makes room for `size` elements; contents undefined then. All work with the old ones must have been waited for.
  void Reserve(const CudaDevicePtr& device, size_t size) {
    if (size <= size_) return;
    *this = DeviceArray();
    *this = DeviceArray(device, size);
  }

  /// Queue copies of the first `count` elements; the host side must stay valid until the stream has been waited for.
  void Upload(const T* host, size_t count, const CudaStream& stream) const {
    CudaCheck(cudaMemcpyAsync(data_, host, count * sizeof(T), cudaMemcpyHostToDevice, stream.get()), "upload");
  }
  void Download(T* host, size_t count, const CudaStream& stream) const {
    CudaCheck(cudaMemcpyAsync(host, data_, count * sizeof(T), cudaMemcpyDeviceToHost, stream.get()), "download");
  }
  void CopyFrom(const DeviceArray& other, size_t count, const CudaStream& stream) const {
    CudaCheck(cudaMemcpyAsync(data_, other.data_, count * sizeof(T), cudaMemcpyDeviceToDevice, stream.get()), "copy");
  }
  /// The same from another GPU, directly or by way of the host as the driver can.
  void CopyFromPeer(const DeviceArray& other, size_t count, const CudaStream& stream) const {
    CudaCheck(cudaMemcpyPeerAsync(data_, device_->index(), other.data_, other.device_->index(), count * sizeof(T),
                                  stream.get()),
              "copy from another GPU");
  }

 private:
  CudaDevicePtr device_;
  T* data_ = nullptr;
  size_t size_ = 0;
};

/// Why the CUDA runtime finds no device, and what to do about it, of what it and the system say.
/// `status`: of cudaGetDeviceCount. `driver`, `runtime`: the CUDA version that the driver knows (0: there is no driver)
/// and that of this build, 1000 x major + 10 x minor. `forbidden`: a device file that this process may not open, or "".
std::string NoDeviceReason(cudaError_t status, int driver, int runtime, const std::string& forbidden);

/// The path of a GPU's device file in `folder` (/dev) that this process may not both read and write; "" if there is
/// none.
std::string ForbiddenDeviceFile(const std::string& folder);

}  // namespace acmp
