#pragma once

#include <cuda_runtime_api.h>

namespace acmp {

/// Throws ProcessingError "what: CUDA's own text" unless `status` is cudaSuccess.
void CudaCheck(cudaError_t status, const char* what);

}  // namespace acmp
