#pragma once

#include <cuda_runtime_api.h>

namespace acmp {

/// Selects the device for this thread. Throws InvalidInputError that says what is missing: driver, device, or code for
/// the device's architecture.
cudaDeviceProp SelectDevice(int index);

}  // namespace acmp
