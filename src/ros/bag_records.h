#pragma once

#include <cstddef>
#include <filesystem>

namespace acmp {

/// Reads all records of a bag and checks what rosbag follows without looking: lengths, and the positions of chunks and
/// messages that the index gives. rosbag would read, and write, wherever these lead it. Throws InvalidInputError
/// without the file's name. A bag without index, which rosbag refuses, is left to it.
/// @param max_chunk_bytes of a chunk, unpacked
void CheckBagRecords(const std::filesystem::path& path, size_t max_chunk_bytes);

}  // namespace acmp
