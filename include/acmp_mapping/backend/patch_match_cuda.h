#pragma once

#include <memory>

#include "acmp_mapping/patch_match/patch_match.h"

namespace acmp {

/// The CUDA implementation on GPU `cuda_index`: the shared kernel functions with hardware-filtered textures. Throws
/// InvalidInputError that says what is missing: driver, device, or code for the device's architecture.
std::unique_ptr<PatchMatch> MakePatchMatchCuda(int cuda_index);

}  // namespace acmp
