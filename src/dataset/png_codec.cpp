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
  const std::string* input = nullptr;
  size_t position = 0;
  std::string output;
  char message[256] = "";
};

[[noreturn]] void OnError(png_structp png, png_const_charp message) {
  auto* context = static_cast<PngContext*>(png_get_error_ptr(png));
  std::strncpy(context->message, message, sizeof(context->message) - 1);
  png_longjmp(png, 1);
}

void OnWarning(png_structp /*png*/, png_const_charp /*message*/) {}  // e.g. a profile libpng dislikes: pixels are fine

void OnRead(png_structp png, png_bytep target, size_t bytes) {
  auto* context = static_cast<PngContext*>(png_get_io_ptr(png));
  if (bytes > context->input->size() - context->position) png_error(png, "unexpected end of file");
  std::memcpy(target, context->input->data() + context->position, bytes);
  context->position += bytes;
}

/// Reader that is always released. The functions that call setjmp keep no other object with a destructor.
struct Reader {
  explicit Reader(const std::string& content) {
    context.input = &content;
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &context, OnError, OnWarning);
    if (png) info = png_create_info_struct(png);
    if (!info) throw ProcessingError("libpng: out of memory");
    png_set_read_fn(png, &context, OnRead);
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  PngContext context;
  png_structp png = nullptr;
  png_infop info = nullptr;
};

struct Writer {
  Writer() {
    png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &context, OnError, OnWarning);
    if (png) info = png_create_info_struct(png);
    if (!info) throw ProcessingError("libpng: out of memory");
  }
  ~Writer() { png_destroy_write_struct(&png, &info); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  PngContext context;
  png_structp png = nullptr;
  png_infop info = nullptr;
};

bool ReadHeader(Reader* reader) {
  if (setjmp(png_jmpbuf(reader->png))) return false;
  png_read_info(reader->png, reader->info);
  return true;
}

// Everything becomes 8-bit RGB: palettes and low bit depths are expanded, 16 bits scaled, alpha dropped.
bool SetColorTransforms(Reader* reader) {
  if (setjmp(png_jmpbuf(reader->png))) return false;
  png_set_expand(reader->png);
  png_set_scale_16(reader->png);
  png_set_strip_alpha(reader->png);
  png_set_gray_to_rgb(reader->png);
  png_set_interlace_handling(reader->png);
  png_read_update_info(reader->png, reader->info);
  return true;
}

bool SetGray16Transforms(Reader* reader) {
  if (setjmp(png_jmpbuf(reader->png))) return false;
  png_set_swap(reader->png);  // PNG is big endian
  png_set_interlace_handling(reader->png);
  png_read_update_info(reader->png, reader->info);
  return true;
}

bool ReadRows(Reader* reader, png_bytepp rows) {
  if (setjmp(png_jmpbuf(reader->png))) return false;
  png_read_image(reader->png, rows);
  png_read_end(reader->png, nullptr);
  return true;
}

[[noreturn]] void Fail(const std::filesystem::path& path, const Reader& reader) {
  throw InvalidInputError(Concat(path.string(), ": damaged PNG file: ", reader.context.message));
}

ImageSize ReadCheckedHeader(const std::filesystem::path& path, Reader* reader) {
  if (!ReadHeader(reader)) Fail(path, *reader);
  const uint64_t width = png_get_image_width(reader->png, reader->info);
  const uint64_t height = png_get_image_height(reader->png, reader->info);
  CheckImageSize(path, width, height);
  return {static_cast<int>(width), static_cast<int>(height)};
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

template <class T>
Image<T> ReadPixels(const std::filesystem::path& path, const ImageSize& size, Reader* reader) {
  if (png_get_rowbytes(reader->png, reader->info) != sizeof(T) * size.width) {
    throw InvalidInputError(Concat(path.string(), ": unsupported kind of PNG pixels"));
  }
  Image<T> image(size.width, size.height);
  std::vector<png_bytep> rows = RowPointers(image.View());
  if (!ReadRows(reader, rows.data())) Fail(path, *reader);
  return image;
}

void OnWrite(png_structp png, png_bytep data, size_t bytes) {
  static_cast<PngContext*>(png_get_io_ptr(png))->output.append(reinterpret_cast<const char*>(data), bytes);
}

void OnFlush(png_structp /*png*/) {}

bool WriteRows(Writer* writer, png_bytepp rows, const ImageSize& size, int color_type, int bit_depth) {
  if (setjmp(png_jmpbuf(writer->png))) return false;
  png_set_write_fn(writer->png, &writer->context, OnWrite, OnFlush);
  png_set_compression_level(writer->png, kCompressionLevel);
  png_set_filter(writer->png, PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
  png_set_IHDR(writer->png, writer->info, size.width, size.height, bit_depth, color_type, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(writer->png, writer->info);
  if (bit_depth == 16) png_set_swap(writer->png);
  png_write_image(writer->png, rows);
  png_write_end(writer->png, nullptr);
  return true;
}

template <class T>
void WritePixels(const std::filesystem::path& path, const Image<T>& image, int color_type, int bit_depth) {
  if (image.empty()) throw InvalidInputError(Concat(path.string(), ": an empty image cannot be written as PNG"));
  Writer writer;
  std::vector<png_bytep> rows = RowPointers(image.View());
  if (!WriteRows(&writer, rows.data(), {image.width(), image.height()}, color_type, bit_depth)) {
    throw ProcessingError(Concat("cannot write ", path.string(), ": ", writer.context.message));
  }
  WriteFileAtomically(path, writer.context.output);
}

}  // namespace

ImageSize DecodePngSize(const std::filesystem::path& path, const std::string& content) {
  Reader reader(content);
  return ReadCheckedHeader(path, &reader);
}

ColorImage DecodePngColor(const std::filesystem::path& path, const std::string& content) {
  Reader reader(content);
  const ImageSize size = ReadCheckedHeader(path, &reader);
  if (!SetColorTransforms(&reader)) Fail(path, reader);
  return ReadPixels<Rgb>(path, size, &reader);
}

Image<uint16_t> ReadPng16(const std::filesystem::path& path) {
  const std::string content = ReadWholeFile(path);
  Reader reader(content);
  const ImageSize size = ReadCheckedHeader(path, &reader);
  const int color_type = png_get_color_type(reader.png, reader.info);
  const int bit_depth = png_get_bit_depth(reader.png, reader.info);
  if (color_type != PNG_COLOR_TYPE_GRAY || bit_depth != 16) {
    throw InvalidInputError(Concat(path.string(), ": PNG with bit depth ", bit_depth, " and colour type ", color_type,
                                   ": must be 16-bit grey (depth 16, type 0)"));
  }
  if (!SetGray16Transforms(&reader)) Fail(path, reader);
  return ReadPixels<uint16_t>(path, size, &reader);
}

void WritePng(const std::filesystem::path& path, const ColorImage& image) {
  WritePixels(path, image, PNG_COLOR_TYPE_RGB, 8);
}

void WritePng16(const std::filesystem::path& path, const Image<uint16_t>& image) {
  WritePixels(path, image, PNG_COLOR_TYPE_GRAY, 16);
}

}  // namespace acmp
