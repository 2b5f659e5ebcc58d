#include "cuda_resources.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

void CudaCheck(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw ProcessingError(Concat(what, ": ", cudaGetErrorString(status), " (", cudaGetErrorName(status), ")"));
}

void* PinnedBuffer::ReserveBytes(size_t bytes) {
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

}  // namespace acmp
