#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"

namespace acmp {

// Files of the work folder: intermediate results as they are in memory, whole or absent, each with its checksum
// (CRC-32, some GB/s). After a power cut a file that was not on the disk yet can be there without its content.

enum class WorkFileState {
  kMissing,
  kWhole,
  kDamaged,  ///< of another length or content than was written, or not a work file of this version
};
/// Reads the whole file.
WorkFileState CheckWorkFile(const std::filesystem::path& path);

void WriteWorkFile(const std::filesystem::path& path, const std::string& content);
/// Nothing where the file is missing or damaged.
std::optional<std::string> ReadWorkFile(const std::filesystem::path& path);

/// Intermediate result of one image.
void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate);
/// Throws ProcessingError when the file is damaged.
EstimateState ReadEstimate(const std::filesystem::path& path);

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps);
/// Throws ProcessingError when the file is damaged.
FinalMaps ReadFinalMaps(const std::filesystem::path& path);

/// CRC-32 of what has this checksum and is followed by these bytes. @param checksum 0: of nothing
uint32_t AddToChecksum(uint32_t checksum, const void* data, size_t bytes);
/// "123 456 none": CRC-32 of any files' content; none for one that cannot be read.
std::string ChecksumsOf(const std::vector<std::filesystem::path>& paths);

}  // namespace acmp
