#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <mutex>
#include <vector>

#include "acmp_mapping/image/image.h"
#include "cuda_resources.h"
#include "fair_shared_mutex.h"

namespace acmp {

/// Owns grey images as the layers of one texture: bilinear, clamped to the border, pixel centres at +0.5. One texture
/// for all, because threads of a warp that read different textures wait for each other. 16 bits hold 1/257 of a grey
/// level and take half the cache of a float. Smaller images are continued to the layers' size by their last column and
/// row, as clamping would. It grows in size and layers and never shrinks.
class TexturePool {
 public:
  TexturePool() = default;
  ~TexturePool();
  TexturePool(const TexturePool&) = delete;
  TexturePool& operator=(const TexturePool&) = delete;

  /// Takes a layer for an image of this size. `images` is held alone while the pool grows.
  int Acquire(int width, int height, const CudaStream& stream, FairSharedMutex* images);
  /// Gives the layer back; nobody may be reading it.
  void Release(int layer) noexcept;

  /// Copies an image (0..255) into a layer through `staging` and waits for it.
  void Upload(const ImageView<const float>& image, int layer, PinnedBuffer* staging, const CudaStream& stream) const;
  /// Queues the means of 2 x 2 pixels of a layer of another pool into `layer` of this.
  void QueueHalf(const TexturePool& from, int from_layer, int layer, const CudaStream& stream) const;

  size_t Bytes() const {
    return sizeof(uint16_t) * static_cast<size_t>(storage_.width) * storage_.height * storage_.layers;
  }
  cudaTextureObject_t texture() const { return storage_.texture; }

 private:
  struct Storage {
    cudaArray_t array = nullptr;
    cudaTextureObject_t texture = 0;
    cudaSurfaceObject_t surface = 0;
    int width = 0, height = 0, layers = 0;
  };
  struct LayerSize {
    int width = 0, height = 0;  ///< of the image in it, px; 0: free
  };
  static Storage Allocate(int width, int height, int layers);
  static void Free(Storage* storage) noexcept;
  int TakeFreeLayer(int width, int height);
  void Grow(int width, int height, const CudaStream& stream);

  Storage storage_;
  std::mutex layers_mutex_;
  std::vector<LayerSize> layers_;
};

}  // namespace acmp
