#pragma once

#include <memory>
#include <string>

#include "acmp_mapping/patch_match/patch_match.h"

namespace acmp {

enum class Device { kAuto, kCuda, kCpu };

/// "auto", "cuda" or "cpu"; throws InvalidInputError for anything else.
Device ParseDevice(const std::string& name);

struct PatchMatchBackend {
  std::unique_ptr<PatchMatch> patch_match;
  std::string fallback_reason;  ///< why kAuto settled for the CPU; empty otherwise
};

/// Makes the implementation for a device. kAuto takes the GPU when there is a usable one, else the CPU with the reason.
/// kCuda throws InvalidInputError that says what is missing (not built in, no driver, no device, device too old).
/// @param cuda_index which GPU, 0-based
PatchMatchBackend MakePatchMatch(Device device, int cuda_index = 0);

}  // namespace acmp
