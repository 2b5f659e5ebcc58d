#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// ".jpg" for "a/B.JPG".
std::string LowerExtension(const std::filesystem::path& path);

/// Reads an 8-bit PNG or JPEG (grey, palette, alpha and 16-bit are converted). Throws InvalidInputError naming the file
/// when it is missing, truncated or of another kind.
ColorImage ReadColorImage(const std::filesystem::path& path);

/// Reads a 16-bit grey PNG. Throws InvalidInputError.
Image<uint16_t> ReadPng16(const std::filesystem::path& path);

/// Writers go to a temporary name and rename, so that a file is either whole or absent. Throw ProcessingError with the
/// system's reason (no space, not writable).
void WritePng(const std::filesystem::path& path, const ColorImage& image);
/// JPEG (quality 98, colour at full resolution) when the name ends in .jpg or .jpeg, else PNG.
void WriteColorImage(const std::filesystem::path& path, const ColorImage& image);
void WritePng16(const std::filesystem::path& path, const Image<uint16_t>& image);

}  // namespace acmp
