#include "cuda_resources.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "texture_fill.h"

namespace acmp {

void CudaCheck(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw ProcessingError(Concat(what, ": ", cudaGetErrorString(status), " (", cudaGetErrorName(status), ")"));
}

CudaStream::CudaStream() { CudaCheck(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "create stream"); }
// Destructors cannot report; after a device failure there is nothing left to release.
CudaStream::~CudaStream() { cudaStreamDestroy(stream_); }
void CudaStream::Synchronize() const { CudaCheck(cudaStreamSynchronize(stream_), "run kernels"); }

CudaEvent::CudaEvent() { CudaCheck(cudaEventCreate(&event_), "create event"); }
CudaEvent::~CudaEvent() { cudaEventDestroy(event_); }
void CudaEvent::Record(const CudaStream& stream) const {
  CudaCheck(cudaEventRecord(event_, stream.get()), "record event");
}
double CudaEvent::ElapsedMs(const CudaEvent& start, const CudaEvent& end) {
  float ms = 0;
  CudaCheck(cudaEventElapsedTime(&ms, start.event_, end.event_), "read event");
  return ms;
}

DeviceBytes::~DeviceBytes() { cudaFree(data_); }

void* DeviceBytes::Reserve(size_t bytes) {
  if (bytes <= capacity_) return data_;
  cudaFree(data_);
  data_ = nullptr;
  capacity_ = 0;
  const cudaError_t status = cudaMalloc(&data_, bytes);
  if (status != cudaSuccess) {
    cudaGetLastError();  // out of memory is not sticky: the device stays usable
    data_ = nullptr;
    CudaCheck(status, Concat("allocate ", bytes, " bytes of GPU memory").c_str());
  }
  capacity_ = bytes;
  return data_;
}

DeviceTexture::~DeviceTexture() { Release(); }

void DeviceTexture::Release() noexcept {
  if (surface_ != 0) cudaDestroySurfaceObject(surface_);
  if (texture_ != 0) cudaDestroyTextureObject(texture_);
  if (array_ != nullptr) cudaFreeArray(array_);
  surface_ = 0;
  texture_ = 0;
  array_ = nullptr;
  width_ = height_ = layers_ = 0;
}

void DeviceTexture::Allocate(int width, int height, int layers) {
  Release();
  const cudaChannelFormatDesc format = cudaCreateChannelDesc(16, 0, 0, 0, cudaChannelFormatKindUnsigned);
  const cudaExtent extent = {static_cast<size_t>(width), static_cast<size_t>(height), static_cast<size_t>(layers)};
  const cudaError_t status = cudaMalloc3DArray(&array_, &format, extent, cudaArrayLayered | cudaArraySurfaceLoadStore);
  if (status != cudaSuccess) {
    cudaGetLastError();
    array_ = nullptr;
    CudaCheck(status, Concat("allocate a ", width, " x ", height, " texture of ", layers, " layers").c_str());
  }
  cudaResourceDesc resource = {};
  resource.resType = cudaResourceTypeArray;
  resource.res.array.array = array_;
  cudaTextureDesc texture = {};
  texture.addressMode[0] = cudaAddressModeClamp;
  texture.addressMode[1] = cudaAddressModeClamp;
  texture.filterMode = cudaFilterModeLinear;
  texture.readMode = cudaReadModeNormalizedFloat;
  CudaCheck(cudaCreateTextureObject(&texture_, &resource, &texture, nullptr), "create texture");
  CudaCheck(cudaCreateSurfaceObject(&surface_, &resource), "create surface");
  width_ = width;
  height_ = height;
  layers_ = layers;
}

void DeviceTexture::Upload(const std::vector<ImageView<const float>>& images, const CudaStream& stream) {
  int width = 1, height = 1;
  size_t pixels = 0;
  for (const ImageView<const float>& image : images) {
    width = std::max(width, image.width);
    height = std::max(height, image.height);
    pixels += static_cast<size_t>(image.width) * image.height;
  }
  const int layers = static_cast<int>(images.size());
  if (width != width_ || height != height_ || layers > layers_) Allocate(width, height, std::max(layers, 1));
  staging_.Resize(pixels);
  float* staged = staging_.data();
  for (int i = 0; i < layers; ++i) {
    const ImageView<const float>& image = images[static_cast<size_t>(i)];
    const size_t row_bytes = static_cast<size_t>(image.width) * sizeof(float);
    CudaCheck(cudaMemcpy2DAsync(staged, row_bytes, image.data, static_cast<size_t>(image.stride) * sizeof(float),
                                row_bytes, static_cast<size_t>(image.height), cudaMemcpyHostToDevice, stream.get()),
              "upload image");
    LaunchFillLayer({staged, image.width, image.height, image.width}, surface_, width_, height_, i, stream.get());
    staged += static_cast<size_t>(image.width) * image.height;
  }
}

}  // namespace acmp
