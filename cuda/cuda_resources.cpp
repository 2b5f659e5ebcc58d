#include "cuda_resources.h"

#include "acmp_mapping/common/error.h"

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
  if (texture_ != 0) cudaDestroyTextureObject(texture_);
  if (array_ != nullptr) cudaFreeArray(array_);
  texture_ = 0;
  array_ = nullptr;
  width_ = height_ = 0;
}

void DeviceTexture::Allocate(int width, int height) {
  Release();
  const cudaChannelFormatDesc format = cudaCreateChannelDesc(32, 0, 0, 0, cudaChannelFormatKindFloat);
  const cudaError_t status = cudaMallocArray(&array_, &format, static_cast<size_t>(width), static_cast<size_t>(height));
  if (status != cudaSuccess) {
    cudaGetLastError();
    array_ = nullptr;
    CudaCheck(status, Concat("allocate a ", width, " x ", height, " texture").c_str());
  }
  cudaResourceDesc resource = {};
  resource.resType = cudaResourceTypeArray;
  resource.res.array.array = array_;
  cudaTextureDesc texture = {};
  texture.addressMode[0] = cudaAddressModeClamp;
  texture.addressMode[1] = cudaAddressModeClamp;
  texture.filterMode = cudaFilterModeLinear;
  texture.readMode = cudaReadModeElementType;
  CudaCheck(cudaCreateTextureObject(&texture_, &resource, &texture, nullptr), "create texture");
  width_ = width;
  height_ = height;
}

void DeviceTexture::Upload(const ImageView<const float>& image, const CudaStream& stream) {
  if (image.width != width_ || image.height != height_) Allocate(image.width, image.height);
  const size_t row_bytes = static_cast<size_t>(image.width) * sizeof(float);
  CudaCheck(
      cudaMemcpy2DToArrayAsync(array_, 0, 0, image.data, static_cast<size_t>(image.stride) * sizeof(float), row_bytes,
                               static_cast<size_t>(image.height), cudaMemcpyHostToDevice, stream.get()),
      "upload image");
}

}  // namespace acmp
