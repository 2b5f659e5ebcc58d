#pragma once

#include <filesystem>
#include <functional>

#include <rosbag/bag.h>

#include "acmp_mapping/common/memory_limit.h"

namespace acmp {

/// Checks the records of a bag, which rosbag does not, and opens it for read(bag). What rosbag throws, there too,
/// becomes an InvalidInputError that names the file and says whether it is missing, cut off, damaged or no bag;
/// InvalidInputErrors of read go through as they are.
/// @param when_cut_off what to do about a file that was cut off; ends a sentence
/// @param max_bytes that reading a chunk may take
void ReadBag(const std::filesystem::path& path, const char* when_cut_off,
             const std::function<void(const rosbag::Bag&)>& read, size_t max_bytes = kMemoryLimitBytes);

}  // namespace acmp
