#pragma once

#include <memory>
#include <string>

#include "acmp_mapping/engine/depth_engine.h"

namespace acmp {

enum class Device { kAuto, kCuda, kCpu };

/// "auto", "cuda" or "cpu"; throws InvalidInputError for anything else.
Device ParseDevice(const std::string& name);

struct DepthEngineBackend {
  std::unique_ptr<DepthEngine> engine;
  std::string fallback_reason;  ///< why kAuto settled for the CPU; empty otherwise
};

/// Makes the engine for a device. kAuto takes the GPU when there is a usable one, else the CPU with the reason. kCuda
/// throws InvalidInputError that says what is missing (not built in, no driver, no device, device too old).
/// @param cuda_index which GPU, 0-based
DepthEngineBackend MakeDepthEngine(Device device, int cuda_index = 0);

/// The engine of GPU `cuda_index`, in CUDA builds only: images and estimates stay in its memory. Throws
/// InvalidInputError that says what is missing: driver, device, or code for the device's architecture.
std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index);

}  // namespace acmp
