#include <png.h>

#include <csetjmp>
#include <cstring>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/output_file.h"
#include "image_codec_private.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr int kCompressionLevel = 1;  // zlib; 6 takes several times as long for a tenth of the bytes

struct PngContext {
  std::string_view input;
  size_t position = 0;
  std::string output;
  char message[256] = "out of memory";
};

[[noreturn]] void OnError(png_structp png, png_const_charp message) {
  auto* context = static_cast<PngContext*>(png_get_error_ptr(png));
  std::strncpy(context->message, message, sizeof(context->message) - 1);
  png_longjmp(png, 1);
}

void OnWarning(png_structp /*png*/, png_const_charp /*message*/) {}  // e.g. a profile libpng dislikes: pixels are fine

void OnRead(png_structp png, png_bytep target, size_t bytes) {
  auto* context = static_cast<PngContext*>(png_get_io_ptr(png));
  if (bytes > context->input.size() - context->position) png_error(png, "unexpected end of file");
  std::memcpy(target, context->input.data() + context->position, bytes);
  context->position += bytes;
}

void OnWrite(png_structp png, png_bytep data, size_t bytes) {
  static_cast<PngContext*>(png_get_io_ptr(png))->output.append(reinterpret_cast<const char*>(data), bytes);
}

void OnFlush(png_structp /*png*/) {}

/// False where libpng reports an error. `work` must not make objects with destructors: it is left by longjmp.
template <class Work>
bool Guarded(png_structp png, const Work& work) {
  if (setjmp(png_jmpbuf(png))) return false;
  work();
  return true;
}

/// The first chunk of every PNG file.
struct PngHeader {
  ImageSize size;
  int bit_depth, color_type;
};

PngHeader ReadPngHeader(const std::filesystem::path& path, std::string_view content) {
  constexpr char kStart[] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR";  // signature, length and name of the chunk
  constexpr size_t kAt = sizeof(kStart) - 1, kBytes = 10;
  if (content.size() < kAt + kBytes || content.compare(0, kAt, kStart, kAt) != 0) {
    throw InvalidInputError(Concat(path.string(), ": damaged PNG file: no header"));
  }
  const auto* bytes = reinterpret_cast<png_const_bytep>(content.data()) + kAt;
  const uint64_t width = png_get_uint_32(bytes), height = png_get_uint_32(bytes + 4);
  CheckImageSize(path, width, height);
  return {{static_cast<int>(width), static_cast<int>(height)}, bytes[8], bytes[9]};
}

template <class T>
std::vector<png_bytep> RowPointers(ImageView<T> image) {
  std::vector<png_bytep> rows(image.height);
  // libpng takes non-const rows for writing too, and does not modify them.
  for (int row = 0; row < image.height; ++row) {
    rows[row] = reinterpret_cast<png_bytep>(const_cast<std::remove_const_t<T>*>(&image(0, row)));
  }
  return rows;
}

/// @param set_transforms tells libpng how to make pixels of type T
template <class T>
Image<T> Decode(const std::filesystem::path& path, std::string_view content, const ImageSize& size,
                void (*set_transforms)(png_structp)) {
  Image<T> image(size.width, size.height);
  std::vector<png_bytep> rows = RowPointers(image.View());
  PngContext context;
  context.input = content;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &context, OnError, OnWarning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  const bool whole = info && Guarded(png, [&] {
                       png_set_read_fn(png, &context, OnRead);
                       png_read_info(png, info);
                       set_transforms(png);
                       png_set_interlace_handling(png);
                       png_read_update_info(png, info);
                       if (png_get_rowbytes(png, info) != sizeof(T) * size.width) png_error(png, "unknown pixels");
                       png_read_image(png, rows.data());
                       png_read_end(png, nullptr);
                     });
  png_destroy_read_struct(&png, &info, nullptr);
  if (!whole) throw InvalidInputError(Concat(path.string(), ": damaged PNG file: ", context.message));
  return image;
}

template <class T>
void WritePixels(const std::filesystem::path& path, const Image<T>& image, int color_type, int bit_depth) {
  if (image.empty()) throw InvalidInputError(Concat(path.string(), ": an empty image cannot be written as PNG"));
  std::vector<png_bytep> rows = RowPointers(image.View());
  PngContext context;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &context, OnError, OnWarning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  const bool whole = info && Guarded(png, [&] {
                       png_set_write_fn(png, &context, OnWrite, OnFlush);
                       png_set_compression_level(png, kCompressionLevel);
                       png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
                       png_set_IHDR(png, info, image.width(), image.height(), bit_depth, color_type, PNG_INTERLACE_NONE,
                                    PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
                       png_write_info(png, info);
                       if (bit_depth == 16) png_set_swap(png);
                       png_write_image(png, rows.data());
                       png_write_end(png, nullptr);
                     });
  png_destroy_write_struct(&png, &info);
  if (!whole) throw ProcessingError(Concat("cannot write ", path.string(), ": ", context.message));
  WriteFileAtomically(path, context.output);
}

}  // namespace

ImageSize DecodePngSize(const std::filesystem::path& path, std::string_view content) {
  return ReadPngHeader(path, content).size;
}

ColorImage DecodePngColor(const std::filesystem::path& path, std::string_view content) {
  // Everything becomes 8-bit RGB: palettes and low bit depths are expanded, 16 bits scaled, alpha dropped.
  return Decode<Rgb>(path, content, ReadPngHeader(path, content).size, [](png_structp png) {
    png_set_expand(png);
    png_set_scale_16(png);
    png_set_strip_alpha(png);
    png_set_gray_to_rgb(png);
  });
}

bool IsPng16(std::string_view content) {
  constexpr size_t kSignature = 8;
  if (content.compare(0, kSignature, "\x89PNG\r\n\x1a\n") != 0) return false;
  const PngHeader header = ReadPngHeader("", content);
  return header.color_type == PNG_COLOR_TYPE_GRAY && header.bit_depth == 16;
}

Image<uint16_t> DecodePng16(const std::string& name, std::string_view content) {
  const PngHeader header = ReadPngHeader(name, content);
  if (header.color_type != PNG_COLOR_TYPE_GRAY || header.bit_depth != 16) {
    throw InvalidInputError(Concat(name, ": PNG with bit depth ", header.bit_depth, " and colour type ",
                                   header.color_type, ": must be 16-bit grey (depth 16, type 0)"));
  }
  return Decode<uint16_t>(name, content, header.size, [](png_structp png) { png_set_swap(png); });  // big endian
}

Image<uint16_t> ReadPng16(const std::filesystem::path& path) { return DecodePng16(path.string(), ReadInput(path)); }

void WritePng(const std::filesystem::path& path, const ColorImage& image) {
  WritePixels(path, image, PNG_COLOR_TYPE_RGB, 8);
}

void WritePng16(const std::filesystem::path& path, const Image<uint16_t>& image) {
  WritePixels(path, image, PNG_COLOR_TYPE_GRAY, 16);
}

}  // namespace acmp
