#pragma once

#include <memory>

#include "acmp_mapping/engine/depth_engine.h"

namespace acmp {

/// The engine of GPU `cuda_index`: images and estimates stay in its memory. Throws InvalidInputError that says what is
/// missing: driver, device, or code for the device's architecture.
/// @param multiprocessors as of MakeDepthEngine
std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index, int multiprocessors);

}  // namespace acmp
