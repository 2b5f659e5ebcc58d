#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace acmp {

/// What one message or file may take while it is worked on, where nobody says otherwise.
constexpr double kMemoryLimitGb = 1;
constexpr size_t kMemoryLimitBytes = static_cast<size_t>(kMemoryLimitGb * 1e9);

/// To be asked before memory is: throws InvalidInputError that names what would take more, and how much.
/// @param what begins the sentence, such as "image of 40000x40000 pixels"
void CheckMemory(const std::string& what, uint64_t count, uint64_t bytes_each, size_t max_bytes);

/// A quarter of this machine's memory, or of what its container may take, GB.
double DefaultMemoryLimitGb();

}  // namespace acmp
