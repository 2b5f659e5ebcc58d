#include <turbojpeg.h>

#include <memory>

#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"

namespace acmp {
namespace {

constexpr int kQuality = 98;  // of 100: errors of a grey level, below sensor noise

using JpegHandle = std::unique_ptr<void, int (*)(tjhandle)>;

const unsigned char* BytesOf(std::string_view content) {
  return reinterpret_cast<const unsigned char*>(content.data());
}

[[noreturn]] void Fail(const std::filesystem::path& path, const std::string& why) {
  throw InvalidInputError(Concat(path.string(), ": damaged JPEG file: ", why));
}

ImageSize ReadHeader(const std::filesystem::path& path, std::string_view content, tjhandle decoder) {
  int width = 0, height = 0, subsampling = 0, colors = 0;
  tjDecompressHeader3(decoder, BytesOf(content), content.size(), &width, &height, &subsampling, &colors);
  // Where it knows the size and fails all the same the sampling is unusual, which is not asked for.
  if (width == 0 || height == 0) Fail(path, tjGetErrorStr2(decoder));
  if (colors == TJCS_CMYK || colors == TJCS_YCCK) {
    throw InvalidInputError(
        Concat(path.string(), ": a JPEG file of 4 colours (CMYK): must be grey or of 3 colours (RGB, YCbCr)"));
  }
  CheckImageSize(path, static_cast<uint64_t>(width), static_cast<uint64_t>(height));
  return {width, height};
}

/// The image ends after the header of its last scan; the end of a thumbnail in the file comes before that.
bool HasEnd(std::string_view content) {
  const size_t end = content.rfind("\xff\xd9"), scan = content.rfind("\xff\xda");
  return end != std::string_view::npos && (scan == std::string_view::npos || scan < end);
}

}  // namespace

ImageSize DecodeJpegSize(const std::filesystem::path& path, std::string_view content) {
  const JpegHandle decoder(tjInitDecompress(), tjDestroy);
  return ReadHeader(path, content, decoder.get());
}

ColorImage DecodeJpeg(const std::filesystem::path& path, std::string_view content) {
  const JpegHandle decoder(tjInitDecompress(), tjDestroy);
  const ImageSize size = ReadHeader(path, content, decoder.get());
  ColorImage image(size.width, size.height);
  if (tjDecompress2(decoder.get(), BytesOf(content), content.size(), reinterpret_cast<unsigned char*>(image.data()),
                    size.width, 0, size.height, TJPF_RGB, TJFLAG_ACCURATEDCT) != 0) {
    // What is missing is filled up with grey, and only warned of. Stray bytes between markers, which some cameras
    // write, do no harm to the pixels.
    const std::string message = tjGetErrorStr2(decoder.get());
    const bool is_warning = tjGetErrorCode(decoder.get()) == TJERR_WARNING;
    if (!is_warning || message.find("extraneous bytes before marker") == std::string::npos) Fail(path, message);
  }
  if (!HasEnd(content)) Fail(path, "it has no end");
  return image;
}

std::string EncodeJpeg(const std::filesystem::path& path, const ColorImage& image) {
  const JpegHandle encoder(tjInitCompress(), tjDestroy);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): TurboJPEG's type
  const int failure = tjCompress2(encoder.get(), reinterpret_cast<const unsigned char*>(image.data()), image.width(), 0,
                                  image.height(), TJPF_RGB, &bytes, &size, TJSAMP_444, kQuality, TJFLAG_ACCURATEDCT);
  const std::unique_ptr<unsigned char, void (*)(unsigned char*)> owned(bytes, tjFree);
  if (failure != 0) {
    throw ProcessingError(Concat("cannot write ", path.string(), " as JPEG: ", tjGetErrorStr2(encoder.get())));
  }
  return {reinterpret_cast<const char*>(bytes), size};
}

}  // namespace acmp
