#include "cuda_resources.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

void CudaCheck(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw ProcessingError(Concat(what, ": ", cudaGetErrorString(status), " (", cudaGetErrorName(status), ")"));
}

CudaStream::CudaStream(const MultiprocessorShare* share) {
  if (share != nullptr) {
    stream_ = share->MakeStream();
  } else {
    CudaCheck(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "create stream");
  }
}
// Destructors cannot report; after a device failure there is nothing left to release.
CudaStream::~CudaStream() { cudaStreamDestroy(stream_); }
void CudaStream::Synchronize() const { CudaCheck(cudaStreamSynchronize(stream_), "run kernels"); }

CudaEvent::CudaEvent() { CudaCheck(cudaEventCreate(&event_), "create event"); }
CudaEvent::~CudaEvent() { cudaEventDestroy(event_); }
void CudaEvent::Record(const CudaStream& stream) const {
  CudaCheck(cudaEventRecord(event_, stream.get()), "record event");
}
void CudaEvent::Wait() const { CudaCheck(cudaEventSynchronize(event_), "run kernels"); }
double CudaEvent::ElapsedMs(const CudaEvent& start, const CudaEvent& end) {
  float ms = 0;
  CudaCheck(cudaEventElapsedTime(&ms, start.event_, end.event_), "read event");
  return ms;
}

PinnedBuffer::~PinnedBuffer() { cudaFreeHost(data_); }

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
