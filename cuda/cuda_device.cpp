#include "cuda_device.h"

#include "acmp_mapping/common/error.h"
#include "cuda_check.h"
#include "patch_match_kernels.h"

namespace acmp {

cudaDeviceProp SelectDevice(int index) {
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status != cudaSuccess) {
    throw InvalidInputError(Concat("no usable CUDA device: ", cudaGetErrorString(status)));
  }
  if (index < 0 || index >= count) {
    throw InvalidInputError(Concat("CUDA device index = ", index, ": must be in [0, ", count - 1, "]"));
  }
  CudaCheck(cudaSetDevice(index), "select device");
  cudaDeviceProp properties;
  CudaCheck(cudaGetDeviceProperties(&properties, index), "read device properties");
  const cudaError_t probe = ProbeKernels();
  if (probe != cudaSuccess) {
    cudaGetLastError();
    throw InvalidInputError(Concat("this build has no code for ", properties.name, " (compute capability ",
                                   properties.major, ".", properties.minor, ": ", cudaGetErrorString(probe),
                                   "); configure with -DACMP_CUDA_ARCHITECTURES=", properties.major, properties.minor));
  }
  return properties;
}

}  // namespace acmp
