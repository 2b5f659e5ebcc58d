#include <turbojpeg.h>

#include <memory>

#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"

namespace acmp {
namespace {

constexpr int kMaxScans = 100;  // encoders make 10 to 14; each costs the time of the whole image, and 12 bytes
constexpr int kQuality = 98;    // of 100: errors of a grey level, below sensor noise

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

/// What the image itself has, from one marker to the next: not a thumbnail, nor what follows it.
struct Markers {
  int scans = 0;
  bool has_end = false;
};

Markers ReadMarkers(std::string_view content) {
  Markers markers;
  const auto byte = [content](size_t at) { return static_cast<unsigned char>(content[at]); };
  size_t at = 2;
  while ((at = content.find('\xff', at)) != std::string_view::npos && at + 1 < content.size()) {
    const unsigned char marker = byte(at + 1);
    if (marker == 0xd9) {
      markers.has_end = true;
      break;
    }
    if (marker == 0xda) ++markers.scans;
    if (marker == 0xff) {  // fills up
      ++at;
    } else if (marker <= 0x01 || (marker >= 0xd0 && marker <= 0xd8)) {  // within a scan, or without a length
      at += 2;
    } else if (at + 3 < content.size()) {
      at += 2 + (size_t{byte(at + 2)} << 8) + byte(at + 3);
    } else {
      break;
    }
  }
  return markers;
}

/// Whether what the decoder warned of does no harm to the pixels: stray bytes between markers, which some cameras
/// write, and values in headers that others take as a matter of course.
bool IsHarmless(const std::string& warning) {
  const auto says = [&warning](const char* what) { return warning.find(what) != std::string::npos; };
  return says("extraneous bytes before marker") || says("Invalid SOS parameters for sequential JPEG") ||
         says("unknown JFIF revision number") || says("Unknown Adobe color transform code");
}

}  // namespace

ImageSize DecodeJpegSize(const std::filesystem::path& path, std::string_view content) {
  const JpegHandle decoder(tjInitDecompress(), tjDestroy);
  return ReadHeader(path, content, decoder.get());
}

ColorImage DecodeJpeg(const std::filesystem::path& path, std::string_view content) {
  const JpegHandle decoder(tjInitDecompress(), tjDestroy);
  const ImageSize size = ReadHeader(path, content, decoder.get());
  const Markers markers = ReadMarkers(content);
  if (markers.scans > kMaxScans) Fail(path, Concat(markers.scans, " scans: at most ", kMaxScans));
  ColorImage image(size.width, size.height);
  if (tjDecompress2(decoder.get(), BytesOf(content), content.size(), reinterpret_cast<unsigned char*>(image.data()),
                    size.width, 0, size.height, TJPF_RGB, TJFLAG_ACCURATEDCT) != 0) {
    // What is missing is filled up with grey, and only warned of. Of several warnings TurboJPEG tells the first: one
    // that does no harm may hide that the file is cut.
    const std::string message = tjGetErrorStr2(decoder.get());
    if (tjGetErrorCode(decoder.get()) != TJERR_WARNING || !IsHarmless(message)) Fail(path, message);
    if (!markers.has_end) Fail(path, "it has no end");
  }
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
