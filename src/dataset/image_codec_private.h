#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// Throws InvalidInputError unless the size is 1 x 1 to kMaxImagePixels.
void CheckImageSize(const std::filesystem::path& path, uint64_t width, uint64_t height);

/// Size from the header of a PNG or JPEG file.
ImageSize ReadImageSize(const std::filesystem::path& path);

/// Decoders of a whole file's content; `path` is for messages.
ColorImage DecodePngColor(const std::filesystem::path& path, std::string_view content);
ImageSize DecodePngSize(const std::filesystem::path& path, std::string_view content);
ColorImage DecodeJpeg(const std::filesystem::path& path, std::string_view content);
ImageSize DecodeJpegSize(const std::filesystem::path& path, std::string_view content);

}  // namespace acmp
