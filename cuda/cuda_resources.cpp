#include "cuda_resources.h"

#include "acmp_mapping/common/error.h"
#if CUDART_VERSION >= 12050
#include <cudaTypedefs.h>
#endif

namespace acmp {

void CudaCheck(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw ProcessingError(Concat(what, ": ", cudaGetErrorString(status), " (", cudaGetErrorName(status), ")"));
}

#if CUDART_VERSION >= 12050

namespace {

/// A function of the driver, which is loaded at run time: programs start without one. Throws InvalidInputError where
/// the driver does not have it.
template <class Function>
Function DriverFunction(const char* name) {
  constexpr unsigned kVersion = 12050;  // of the newest of these functions
  void* function = nullptr;
  cudaDriverEntryPointQueryResult found = cudaDriverEntryPointSymbolNotFound;
  const cudaError_t status = cudaGetDriverEntryPointByVersion(name, &function, kVersion, cudaEnableDefault, &found);
  if (status != cudaSuccess || found != cudaDriverEntryPointSuccess) {
    cudaGetLastError();
    throw InvalidInputError(
        Concat("the NVIDIA driver cannot share out multiprocessors (no ", name, "): it must know CUDA 12.5"));
  }
  return reinterpret_cast<Function>(function);
}

void DriverCheck(CUresult status, const char* what) {
  if (status != CUDA_SUCCESS)
    throw ProcessingError(Concat(what, ": error ", static_cast<int>(status), " of the driver"));
}

}  // namespace

MultiprocessorShare::MultiprocessorShare(int device, int count) {
  CudaCheck(cudaSetDevice(device), "select device");
  CudaCheck(cudaFree(nullptr), "start device");
  CUdevResource all = {};
  DriverCheck(DriverFunction<PFN_cuDeviceGetDevResource_v12040>("cuDeviceGetDevResource")(device, &all,
                                                                                          CU_DEV_RESOURCE_TYPE_SM),
              "read multiprocessors");
  CheckRange("multiprocessors", count, 1, static_cast<int>(all.sm.smCount));
  CUdevResource share = {};
  unsigned groups = 1;
  // No kernel of ours is a cluster, which would need whole groups of multiprocessors.
  DriverCheck(DriverFunction<PFN_cuDevSmResourceSplitByCount_v12040>("cuDevSmResourceSplitByCount")(
                  &share, &groups, &all, nullptr, CU_DEV_SM_RESOURCE_SPLIT_IGNORE_SM_COSCHEDULING,
                  static_cast<unsigned>(count)),
              "share out multiprocessors");
  CUdevResourceDesc description = nullptr;
  DriverCheck(
      DriverFunction<PFN_cuDevResourceGenerateDesc_v12040>("cuDevResourceGenerateDesc")(&description, &share, 1),
      "describe multiprocessors");
  CUgreenCtx context = nullptr;
  DriverCheck(DriverFunction<PFN_cuGreenCtxCreate_v12040>("cuGreenCtxCreate")(&context, description, device,
                                                                              CU_GREEN_CTX_DEFAULT_STREAM),
              "make a context of some multiprocessors");
  context_ = context;
  count_ = static_cast<int>(share.sm.smCount);
}

MultiprocessorShare::~MultiprocessorShare() {
  try {
    DriverFunction<PFN_cuGreenCtxDestroy_v12040>("cuGreenCtxDestroy")(static_cast<CUgreenCtx>(context_));
  } catch (const InvalidInputError&) {  // a driver that made it has this, too
  }
}

cudaStream_t MultiprocessorShare::MakeStream() const {
  CUstream stream = nullptr;
  DriverCheck(DriverFunction<PFN_cuGreenCtxStreamCreate_v12050>("cuGreenCtxStreamCreate")(
                  &stream, static_cast<CUgreenCtx>(context_), CU_STREAM_NON_BLOCKING, 0),
              "create stream");
  return stream;
}

#else

MultiprocessorShare::MultiprocessorShare(int /*device*/, int /*count*/) {
  throw InvalidInputError(Concat("multiprocessors: can be shared out from CUDA 12.5 on, this build is of CUDA ",
                                 CUDART_VERSION / 1000, ".", CUDART_VERSION % 1000 / 10));
}
MultiprocessorShare::~MultiprocessorShare() = default;
cudaStream_t MultiprocessorShare::MakeStream() const { return nullptr; }

#endif

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
