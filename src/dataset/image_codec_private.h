#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Largest image that is decoded, so that a corrupt header cannot ask for all memory.
constexpr uint64_t kMaxImagePixels = uint64_t{1} << 28;

struct ImageSize {
  int width = 0;   ///< px
  int height = 0;  ///< px
};

/// Throws InvalidInputError unless the size is 1 x 1 to kMaxImagePixels.
void CheckImageSize(const std::filesystem::path& path, uint64_t width, uint64_t height);

/// Size from the header of a PNG or JPEG file.
ImageSize ReadImageSize(const std::filesystem::path& path);

/// Decoders of a whole file's content; `path` is for messages.
ColorImage DecodePngColor(const std::filesystem::path& path, const std::string& content);
ImageSize DecodePngSize(const std::filesystem::path& path, const std::string& content);
ColorImage DecodeJpeg(const std::filesystem::path& path, const std::string& content);
ImageSize DecodeJpegSize(const std::filesystem::path& path, const std::string& content);

/// Content of a JPEG file; ProcessingError when libjpeg cannot make one. `path` is for messages.
std::string EncodeJpeg(const std::filesystem::path& path, const ColorImage& image);

}  // namespace acmp
