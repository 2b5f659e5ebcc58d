// jpeglib.h needs FILE and size_t declared before it.
#include <cstddef>
#include <cstdio>
// clang-format off
#include <jpeglib.h>
#include <jerror.h>
// clang-format on

#include <csetjmp>

#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"

namespace acmp {
namespace {

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

}  // namespace acmp
