#include "acmp_mapping/dataset/image_codec.h"

#include <algorithm>
#include <cctype>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "image_codec_private.h"
#include "input_file.h"

namespace acmp {
namespace {

// Where the size is found at the latest: JPEG's metadata segments are at most 64 KiB each and come before it.
constexpr size_t kHeaderBytes = size_t{4} << 20;

enum class FileKind { kPng, kJpeg };

FileKind DetectKind(const std::string& name, std::string_view content) {
  if (content.compare(0, 8, "\x89PNG\r\n\x1a\n") == 0) return FileKind::kPng;
  if (content.compare(0, 3, "\xff\xd8\xff") == 0) return FileKind::kJpeg;
  throw InvalidInputError(Concat(name, ": neither a PNG nor a JPEG file (", content.size(), " bytes)"));
}

}  // namespace

std::string LowerExtension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void CheckImageSize(const std::filesystem::path& path, uint64_t width, uint64_t height) {
  if (width == 0 || height == 0 || width > kMaxImagePixels || height > kMaxImagePixels / width) {
    throw InvalidInputError(Concat(path.string(), ": image size ", width, " x ", height, ": must be 1 x 1 to ",
                                   kMaxImagePixels, " pixels"));
  }
}

ImageSize EncodedImageSize(const std::string& name, std::string_view content) {
  return DetectKind(name, content) == FileKind::kPng ? DecodePngSize(name, content) : DecodeJpegSize(name, content);
}

ImageSize ReadImageSize(const std::filesystem::path& path) {
  return EncodedImageSize(path.string(), ReadInput(path, kHeaderBytes));
}

ColorImage DecodeColorImage(const std::string& name, std::string_view content) {
  return DetectKind(name, content) == FileKind::kPng ? DecodePngColor(name, content) : DecodeJpeg(name, content);
}

ColorImage ReadColorImage(const std::filesystem::path& path) {
  return DecodeColorImage(path.string(), ReadInput(path));
}

ColorImage ReadColorImage(const std::filesystem::path& path, const ImageSize& of_camera) {
  const std::string content = ReadInput(path);
  const ImageSize size = EncodedImageSize(path.string(), content);
  if (size.width != of_camera.width || size.height != of_camera.height) {
    throw InvalidInputError(Concat(path.string(), ": image size ", size.width, " x ", size.height,
                                   " differs from its camera's ", of_camera.width, " x ", of_camera.height));
  }
  return DecodeColorImage(path.string(), content);
}

void WriteColorImage(const std::filesystem::path& path, const ColorImage& image) {
  const std::string extension = LowerExtension(path);
  if (extension == ".jpg" || extension == ".jpeg") {
    WriteFileAtomically(path, EncodeJpeg(path, image));
  } else {
    WritePng(path, image);
  }
}

}  // namespace acmp
