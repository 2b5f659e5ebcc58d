#include "texture_pool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>

#include "acmp_mapping/common/error.h"
#include "kernels.h"

namespace acmp {
namespace {

constexpr int kFirstLayers = 16;
constexpr int kMaxLayers = 2048;  ///< CUDA's limit for layered textures

uint16_t ToTexel(float gray) {
  constexpr float kTexelsPerGray = 257.0f;  // 65535 / 255
  // NOLINTNEXTLINE(bugprone-incorrect-roundings): truncation is rounding here, as nothing is negative
  return static_cast<uint16_t>(kTexelsPerGray * Clamp(gray, 0.0f, 255.0f) + 0.5f);
}

}  // namespace

TexturePool::~TexturePool() { Free(&storage_); }

void TexturePool::Free(Storage* storage) noexcept {
  if (storage->surface != 0) cudaDestroySurfaceObject(storage->surface);
  if (storage->texture != 0) cudaDestroyTextureObject(storage->texture);
  if (storage->array != nullptr) cudaFreeArray(storage->array);
  *storage = {};
}

TexturePool::Storage TexturePool::Allocate(int width, int height, int layers) {
  Storage storage;
  const cudaChannelFormatDesc format = cudaCreateChannelDesc(16, 0, 0, 0, cudaChannelFormatKindUnsigned);
  const cudaExtent extent = {static_cast<size_t>(width), static_cast<size_t>(height), static_cast<size_t>(layers)};
  const cudaError_t status =
      cudaMalloc3DArray(&storage.array, &format, extent, cudaArrayLayered | cudaArraySurfaceLoadStore);
  if (status != cudaSuccess) {
    cudaGetLastError();
    CudaCheck(status, Concat("allocate a ", width, " x ", height, " texture of ", layers, " layers").c_str());
  }
  cudaResourceDesc resource = {};
  resource.resType = cudaResourceTypeArray;
  resource.res.array.array = storage.array;
  cudaTextureDesc texture = {};
  texture.addressMode[0] = cudaAddressModeClamp;
  texture.addressMode[1] = cudaAddressModeClamp;
  texture.filterMode = cudaFilterModeLinear;
  texture.readMode = cudaReadModeNormalizedFloat;
  try {
    CudaCheck(cudaCreateTextureObject(&storage.texture, &resource, &texture, nullptr), "create texture");
    CudaCheck(cudaCreateSurfaceObject(&storage.surface, &resource), "create surface");
  } catch (...) {
    Free(&storage);
    throw;
  }
  storage.width = width;
  storage.height = height;
  storage.layers = layers;
  return storage;
}

int TexturePool::TakeFreeLayer(int width, int height) {
  const std::lock_guard<std::mutex> lock(layers_mutex_);
  if (width > storage_.width || height > storage_.height) return -1;
  const auto free = std::find_if(layers_.begin(), layers_.end(), [](const LayerSize& size) { return size.width == 0; });
  if (free == layers_.end()) return -1;
  *free = {width, height};
  return static_cast<int>(free - layers_.begin());
}

int TexturePool::Acquire(int width, int height, const CudaStream& stream, FairSharedMutex* images) {
  int layer = TakeFreeLayer(width, height);
  while (layer < 0) {
    const std::unique_lock<FairSharedMutex> alone(*images);
    layer = TakeFreeLayer(width, height);  // of a pool that has grown meanwhile
    if (layer < 0) Grow(width, height, stream);
  }
  return layer;
}

void TexturePool::Release(int layer) noexcept {
  const std::lock_guard<std::mutex> lock(layers_mutex_);
  layers_[static_cast<size_t>(layer)] = {};
}

void TexturePool::Grow(int width, int height, const CudaStream& stream) {
  const std::lock_guard<std::mutex> lock(layers_mutex_);
  const bool full = std::all_of(layers_.begin(), layers_.end(), [](const LayerSize& size) { return size.width > 0; });
  const int wanted = full ? std::max(kFirstLayers, 2 * storage_.layers) : storage_.layers;
  if (full && storage_.layers == kMaxLayers) {
    throw ProcessingError(Concat("more than ", kMaxLayers, " images at once on the GPU"));
  }
  Storage grown =
      Allocate(std::max(width, storage_.width), std::max(height, storage_.height), std::min(wanted, kMaxLayers));
  try {
    for (int i = 0; i < storage_.layers; ++i) {
      const LayerSize& size = layers_[static_cast<size_t>(i)];
      if (size.width == 0) continue;
      LaunchFillLayer(storage_.texture, i, 1, grown.surface, {i, size.width, size.height}, grown.width, grown.height,
                      stream.get());
    }
    stream.Synchronize();
  } catch (...) {
    Free(&grown);
    throw;
  }
  Free(&storage_);
  storage_ = grown;
  layers_.resize(static_cast<size_t>(storage_.layers));
}

void TexturePool::Upload(const ImageView<const float>& image, int layer, PinnedBuffer* staging,
                         const CudaStream& stream) const {
  const int width = storage_.width, height = storage_.height;
  uint16_t* texels = staging->Reserve<uint16_t>(static_cast<size_t>(width) * height);
  tbb::parallel_for(0, height, [&](int row) {
    const float* from = &image(0, std::min(row, image.height - 1));
    uint16_t* to = texels + static_cast<size_t>(row) * width;
    std::transform(from, from + image.width, to, ToTexel);
    std::fill(to + image.width, to + width, to[image.width - 1]);
  });
  cudaMemcpy3DParms copy = {};
  const size_t columns = static_cast<size_t>(width), rows = static_cast<size_t>(height);
  copy.srcPtr = {texels, columns * sizeof(uint16_t), columns, rows};
  copy.dstArray = storage_.array;
  copy.dstPos = {0, 0, static_cast<size_t>(layer)};
  copy.extent = {columns, rows, 1};
  copy.kind = cudaMemcpyHostToDevice;
  CudaCheck(cudaMemcpy3DAsync(&copy, stream.get()), "upload image");
  stream.Synchronize();
}

void TexturePool::QueueHalf(const TexturePool& from, int from_layer, int layer, const CudaStream& stream) const {
  const LayerSize& size = layers_[static_cast<size_t>(layer)];
  LaunchFillLayer(from.storage_.texture, from_layer, 2, storage_.surface, {layer, size.width, size.height},
                  storage_.width, storage_.height, stream.get());
}

}  // namespace acmp
