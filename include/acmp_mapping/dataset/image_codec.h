#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// ".jpg" for "a/B.JPG".
std::string LowerExtension(const std::filesystem::path& path);

/// Largest image that is decoded, so that a corrupt header cannot ask for all memory.
constexpr uint64_t kMaxImagePixels = uint64_t{1} << 28;

struct ImageSize {
  int width = 0;   ///< px
  int height = 0;  ///< px
};

/// Reads an 8-bit PNG or JPEG (grey, palette, alpha and 16-bit are converted). Throws InvalidInputError naming the file
/// when it is missing, truncated, of another kind or of more than kMaxImagePixels.
ColorImage ReadColorImage(const std::filesystem::path& path);
/// The same of an image that must have the size of its camera: else throws before memory is asked for.
ColorImage ReadColorImage(const std::filesystem::path& path, const ImageSize& of_camera);

/// Size in the header of a PNG or JPEG file's content, 1 x 1 to kMaxImagePixels. Throws InvalidInputError.
/// @param name for messages
ImageSize EncodedImageSize(const std::string& name, std::string_view content);

/// Decode a PNG's or JPEG's content, as ReadColorImage and ReadPng16 do. `name` is for messages.
ColorImage DecodeColorImage(const std::string& name, std::string_view content);
Image<uint16_t> DecodePng16(const std::string& name, std::string_view content);
/// Whether DecodePng16 takes it.
bool IsPng16(std::string_view content);

/// Content of a JPEG file (quality 98, colour at full resolution); ProcessingError when it cannot be made. `path`
/// is for messages.
std::string EncodeJpeg(const std::filesystem::path& path, const ColorImage& image);

/// Reads a 16-bit grey PNG. Throws InvalidInputError.
Image<uint16_t> ReadPng16(const std::filesystem::path& path);

/// Writers go to a temporary name and rename, so that a file is either whole or absent. Throw ProcessingError with the
/// system's reason (no space, not writable).
void WritePng(const std::filesystem::path& path, const ColorImage& image);
/// JPEG (quality 98, colour at full resolution) when the name ends in .jpg or .jpeg, else PNG.
void WriteColorImage(const std::filesystem::path& path, const ColorImage& image);
void WritePng16(const std::filesystem::path& path, const Image<uint16_t>& image);

}  // namespace acmp
