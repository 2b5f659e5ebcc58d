// jpeglib.h needs FILE and size_t declared before it.
#include <cstddef>
#include <cstdio>
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>

#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"

namespace acmp {
namespace {

constexpr int kQuality = 98;  // of 100: errors of a grey level, below sensor noise

/// libjpeg reports errors through callbacks and must be left by longjmp; messages are kept for the exception.
struct ErrorManager {
  jpeg_error_mgr base;  // first: libjpeg hands back a pointer to it
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
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

/// Decompressor that is always released. The functions that call setjmp keep no other object with a destructor.
struct Decompressor {
  Decompressor() {
    info.err = jpeg_std_error(&errors.base);
    errors.base.error_exit = OnError;
    errors.base.emit_message = OnMessage;
    errors.message[0] = '\0';
  }
  ~Decompressor() { jpeg_destroy_decompress(&info); }
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;

  jpeg_decompress_struct info = {};
  ErrorManager errors;
};

/// Compressor into memory that is always released.
struct Compressor {
  Compressor() {
    info.err = jpeg_std_error(&errors.base);
    errors.base.error_exit = OnError;
    errors.message[0] = '\0';
  }
  ~Compressor() {
    jpeg_destroy_compress(&info);
    std::free(bytes);  // NOLINT(cppcoreguidelines-no-malloc): libjpeg allocates it
  }
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;

  jpeg_compress_struct info = {};
  ErrorManager errors;
  unsigned char* bytes = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
};

bool Compress(Compressor* encoder, const ColorImage& image) {
  if (setjmp(encoder->errors.jump)) return false;
  jpeg_compress_struct& info = encoder->info;
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, &encoder->bytes, &encoder->size);
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
  return true;
}

bool ReadHeader(Decompressor* decoder, const std::string& content) {
  if (setjmp(decoder->errors.jump)) return false;
  jpeg_create_decompress(&decoder->info);
  jpeg_mem_src(&decoder->info, reinterpret_cast<const unsigned char*>(content.data()), content.size());
  jpeg_read_header(&decoder->info, TRUE);
  decoder->info.out_color_space = JCS_RGB;
  return true;
}

bool ReadRows(Decompressor* decoder, ImageView<Rgb> image) {
  if (setjmp(decoder->errors.jump)) return false;
  jpeg_start_decompress(&decoder->info);
  while (decoder->info.output_scanline < decoder->info.output_height) {
    JSAMPROW row = reinterpret_cast<JSAMPROW>(&image(0, static_cast<int>(decoder->info.output_scanline)));
    jpeg_read_scanlines(&decoder->info, &row, 1);
  }
  jpeg_finish_decompress(&decoder->info);
  return true;
}

[[noreturn]] void Fail(const std::filesystem::path& path, const Decompressor& decoder) {
  throw InvalidInputError(Concat(path.string(), ": damaged JPEG file: ", decoder.errors.message));
}

void ReadCheckedHeader(const std::filesystem::path& path, const std::string& content, Decompressor* decoder) {
  if (!ReadHeader(decoder, content)) Fail(path, *decoder);
  CheckImageSize(path, decoder->info.image_width, decoder->info.image_height);
}

}  // namespace

ImageSize DecodeJpegSize(const std::filesystem::path& path, const std::string& content) {
  Decompressor decoder;
  ReadCheckedHeader(path, content, &decoder);
  return {static_cast<int>(decoder.info.image_width), static_cast<int>(decoder.info.image_height)};
}

ColorImage DecodeJpeg(const std::filesystem::path& path, const std::string& content) {
  Decompressor decoder;
  ReadCheckedHeader(path, content, &decoder);
  ColorImage image(static_cast<int>(decoder.info.image_width), static_cast<int>(decoder.info.image_height));
  if (!ReadRows(&decoder, image.View())) Fail(path, decoder);
  return image;
}

std::string EncodeJpeg(const std::filesystem::path& path, const ColorImage& image) {
  Compressor encoder;
  if (!Compress(&encoder, image)) {
    throw ProcessingError(Concat("cannot write ", path.string(), " as JPEG: ", encoder.errors.message));
  }
  return {reinterpret_cast<const char*>(encoder.bytes), encoder.size};
}

}  // namespace acmp
