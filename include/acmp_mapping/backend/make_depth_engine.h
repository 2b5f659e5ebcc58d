#pragma once

#include <memory>
#include <string>

#include "acmp_mapping/backend/make_patch_match.h"
#include "acmp_mapping/engine/depth_engine.h"

namespace acmp {

struct DepthEngineBackend {
  std::unique_ptr<DepthEngine> engine;
  std::string fallback_reason;  ///< why kAuto settled for the CPU; empty otherwise
};

/// Makes the engine for a device, as MakePatchMatch does for single passes.
DepthEngineBackend MakeDepthEngine(Device device, int cuda_index = 0);

}  // namespace acmp
