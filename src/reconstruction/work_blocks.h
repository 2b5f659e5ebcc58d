#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace acmp {

/// A work file of any content, whole or absent, with its checksum.
void WriteBlock(const std::filesystem::path& path, const std::string& content);
/// Nothing where the file is missing or damaged.
std::optional<std::string> ReadBlock(const std::filesystem::path& path);

/// CRC-32 of a file's content; nothing where it cannot be read.
std::optional<uint32_t> ChecksumOfFile(const std::filesystem::path& path);

}  // namespace acmp
