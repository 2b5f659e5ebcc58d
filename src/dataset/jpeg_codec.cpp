// jpeglib.h needs FILE and size_t declared before it.
#include <cstddef>
#include <cstdio>
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>
#include <memory>

#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"

namespace acmp {
namespace {

constexpr int kQuality = 98;  // of 100: errors of a grey level, below sensor noise

/// libjpeg reports errors through callbacks and must be left by longjmp; messages are kept for the exception.
struct ErrorManager {
  jpeg_error_mgr base;  // first: libjpeg hands back a pointer to it
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX] = "";
};

[[noreturn]] void OnError(j_common_ptr info) {
  auto* manager = reinterpret_cast<ErrorManager*>(info->err);
  info->err->format_message(info, manager->message);
  std::longjmp(manager->jump, 1);
}

// libjpeg fills up truncated images with grey and only warns: those warnings are errors here. Others (for example stray
// bytes between markers, which some cameras write) do no harm to the pixels.
void OnMessage(j_common_ptr info, int level) {
  if (level >= 0) return;
  const int code = info->err->msg_code;
  if (code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE || code == JWRN_ARITH_BAD_CODE) {
    OnError(info);
  }
}

/// Compressor or decompressor that is always released.
template <class Info>
struct Codec {
  Codec() {
    info.err = jpeg_std_error(&errors.base);
    errors.base.error_exit = OnError;
    errors.base.emit_message = OnMessage;
  }
  ~Codec() { jpeg_destroy(reinterpret_cast<j_common_ptr>(&info)); }
  Codec(const Codec&) = delete;
  Codec& operator=(const Codec&) = delete;

  /// False where libjpeg reports an error. `work` must not make objects with destructors: it is left by longjmp.
  template <class Work>
  bool Guarded(const Work& work) {
    if (setjmp(errors.jump)) return false;
    work();
    return true;
  }

  Info info = {};
  ErrorManager errors;
};
using Decompressor = Codec<jpeg_decompress_struct>;

[[noreturn]] void Fail(const std::filesystem::path& path, const Decompressor& decoder) {
  throw InvalidInputError(Concat(path.string(), ": damaged JPEG file: ", decoder.errors.message));
}

ImageSize ReadHeader(const std::filesystem::path& path, std::string_view content, Decompressor* decoder) {
  jpeg_decompress_struct& info = decoder->info;
  const bool whole = decoder->Guarded([&] {
    jpeg_create_decompress(&info);
    jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(content.data()), content.size());
    jpeg_read_header(&info, TRUE);
    info.out_color_space = JCS_RGB;
  });
  if (!whole) Fail(path, *decoder);
  if (info.num_components > 3) {
    throw InvalidInputError(Concat(path.string(), ": a JPEG file of ", info.num_components,
                                   " colours (CMYK): must be grey or of 3 colours (RGB, YCbCr)"));
  }
  CheckImageSize(path, info.image_width, info.image_height);
  return {static_cast<int>(info.image_width), static_cast<int>(info.image_height)};
}

}  // namespace

ImageSize DecodeJpegSize(const std::filesystem::path& path, std::string_view content) {
  Decompressor decoder;
  return ReadHeader(path, content, &decoder);
}

ColorImage DecodeJpeg(const std::filesystem::path& path, std::string_view content) {
  Decompressor decoder;
  const ImageSize size = ReadHeader(path, content, &decoder);
  ColorImage image(size.width, size.height);
  const bool whole = decoder.Guarded([&, &info = decoder.info] {
    jpeg_start_decompress(&info);
    while (info.output_scanline < info.output_height) {
      auto* row = reinterpret_cast<JSAMPROW>(&image(0, static_cast<int>(info.output_scanline)));
      jpeg_read_scanlines(&info, &row, 1);
    }
    jpeg_finish_decompress(&info);
  });
  if (!whole) Fail(path, decoder);
  return image;
}

std::string EncodeJpeg(const std::filesystem::path& path, const ColorImage& image) {
  unsigned char* bytes = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
  Codec<jpeg_compress_struct> encoder;
  const bool whole = encoder.Guarded([&, &info = encoder.info] {
    jpeg_create_compress(&info);
    jpeg_mem_dest(&info, &bytes, &size);
    info.image_width = static_cast<JDIMENSION>(image.width());
    info.image_height = static_cast<JDIMENSION>(image.height());
    info.input_components = 3;
    info.in_color_space = JCS_RGB;
    jpeg_set_defaults(&info);
    jpeg_set_quality(&info, kQuality, TRUE);
    info.comp_info[0].h_samp_factor = 1;  // colour at full resolution
    info.comp_info[0].v_samp_factor = 1;
    jpeg_start_compress(&info, TRUE);
    while (info.next_scanline < info.image_height) {
      // libjpeg takes no pointers to const but only reads.
      auto* row = reinterpret_cast<JSAMPROW>(const_cast<Rgb*>(&image(0, static_cast<int>(info.next_scanline))));
      jpeg_write_scanlines(&info, &row, 1);
    }
    jpeg_finish_compress(&info);
  });
  const std::unique_ptr<unsigned char, void (*)(void*)> owned(bytes, std::free);  // libjpeg allocates it
  if (!whole) throw ProcessingError(Concat("cannot write ", path.string(), " as JPEG: ", encoder.errors.message));
  return {reinterpret_cast<const char*>(bytes), size};
}

}  // namespace acmp
