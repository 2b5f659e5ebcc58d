#pragma once

#include <cuda_runtime_api.h>

#include <string>

namespace acmp {

/// Why the CUDA runtime finds no device, and what to do about it, of what it and the system say.
/// `status`: of cudaGetDeviceCount. `driver`, `runtime`: the CUDA version that the driver knows (0: there is no driver)
/// and that of this build, 1000 x major + 10 x minor. `forbidden`: a device file that this process may not open, or "".
std::string NoDeviceReason(cudaError_t status, int driver, int runtime, const std::string& forbidden);

/// The path of a GPU's device file in `folder` (/dev) that this process may not both read and write; "" if there is
/// none.
std::string ForbiddenDeviceFile(const std::string& folder);

}  // namespace acmp
