#include "acmp_mapping/dataset/image_codec.h"
#include <png.h>
#include <turbojpeg.h>

#include <cstdio>
#include <map>
#include <memory>

#include "acmp_mapping/common/random.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ImageCodecTest = TestFolder;

ColorImage RandomColors(int width, int height) {
  ColorImage image(width, height);
  RandomStream random(1, 0, 0);
  for (Rgb& p : image) {
    const uint32_t word = random.NextWord();
    p = {static_cast<unsigned char>(word), static_cast<unsigned char>(word >> 8),
         static_cast<unsigned char>(word >> 16)};
  }
  return image;
}

/// Slow changes only, which JPEG keeps.
ColorImage SmoothColors(int width, int height) {
  ColorImage image(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      image(col, row) = {static_cast<unsigned char>(60 + 2 * col), static_cast<unsigned char>(90 + 2 * row),
                         static_cast<unsigned char>(100 + col)};
    }
  }
  return image;
}

int MaxDifference(const ColorImage& a, const ColorImage& b) {
  EXPECT_EQ(a.width(), b.width());
  EXPECT_EQ(a.height(), b.height());
  int difference = 0;
  for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    const Rgb& p = a.data()[i];
    const Rgb& q = b.data()[i];
    difference = std::max({difference, std::abs(p.r - q.r), std::abs(p.g - q.g), std::abs(p.b - q.b)});
  }
  return difference;
}

/// A PNG of any kind written by libpng itself; `rows` hold the raw samples.
void WriteRawPng(const std::filesystem::path& path, int width, int bit_depth, int color_type,
                 std::vector<std::vector<unsigned char>> rows, int interlace = PNG_INTERLACE_NONE) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_set_IHDR(png, info, width, rows.size(), bit_depth, color_type, interlace, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  const png_color palette[2] = {{10, 20, 30}, {200, 150, 100}};
  if (color_type == PNG_COLOR_TYPE_PALETTE) png_set_PLTE(png, info, palette, 2);
  std::vector<png_bytep> pointers;
  pointers.reserve(rows.size());
  for (auto& row : rows) pointers.push_back(row.data());
  png_write_info(png, info);
  png_write_image(png, pointers.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

/// Of whatever colours TurboJPEG has; samples are bytes one after the other.
void WriteJpeg(const std::filesystem::path& path, int size, int pixel_format, int subsampling,
               const std::vector<unsigned char>& samples) {
  const std::unique_ptr<void, int (*)(tjhandle)> encoder(tjInitCompress(), tjDestroy);
  unsigned char* bytes = nullptr;
  unsigned long count = 0;  // NOLINT(google-runtime-int): TurboJPEG's type
  ASSERT_EQ(
      tjCompress2(encoder.get(), samples.data(), size, 0, size, pixel_format, &bytes, &count, subsampling, 100, 0), 0);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(count));
  tjFree(bytes);
}

TEST_F(ImageCodecTest, NameDecidesWhichKindIsWritten) {
  const ColorImage image = SmoothColors(33, 17);
  for (const char* name : {"a.jpg", "a.JPEG"}) {
    WriteColorImage(folder() / name, image);
    EXPECT_EQ(ReadText(folder() / name).substr(0, 2), "\xff\xd8") << name;
    EXPECT_LE(MaxDifference(ReadColorImage(folder() / name), image), 3) << name;
  }
  for (const char* name : {"a.png", "a", "a.jpg.bmp"}) {
    WriteColorImage(folder() / name, image);
    EXPECT_EQ(MaxDifference(ReadColorImage(folder() / name), image), 0) << name;
  }
}

TEST_F(ImageCodecTest, OtherPngKindsBecomeRgb) {
  const auto path = folder() / "a.png";
  const auto pixel = [&](int col) {
    const ColorImage image = ReadColorImage(path);
    return std::vector<int>{image(col, 0).r, image(col, 0).g, image(col, 0).b};
  };
  WriteRawPng(path, 2, 8, PNG_COLOR_TYPE_GRAY, {{7, 200}});
  EXPECT_EQ(pixel(1), (std::vector<int>{200, 200, 200}));
  WriteRawPng(path, 2, 1, PNG_COLOR_TYPE_PALETTE, {{0x40}});  // indices 0, 1
  EXPECT_EQ(pixel(0), (std::vector<int>{10, 20, 30}));
  EXPECT_EQ(pixel(1), (std::vector<int>{200, 150, 100}));
  WriteRawPng(path, 1, 8, PNG_COLOR_TYPE_RGB_ALPHA, {{9, 8, 7, 0}});  // the colour under the alpha counts
  EXPECT_EQ(pixel(0), (std::vector<int>{9, 8, 7}));
  WriteRawPng(path, 1, 16, PNG_COLOR_TYPE_RGB, {{0xff, 0xff, 0x80, 0x80, 0, 0}});  // 65535, 32896, 0 over 257
  EXPECT_EQ(pixel(0), (std::vector<int>{255, 128, 0}));
}

TEST_F(ImageCodecTest, InterlacedPngIsRead) {
  std::vector<std::vector<unsigned char>> rows(9, std::vector<unsigned char>(11));
  for (int row = 0; row < 9; ++row) {
    for (int col = 0; col < 11; ++col) rows[row][col] = static_cast<unsigned char>(20 * row + col);
  }
  WriteRawPng(folder() / "a.png", 11, 8, PNG_COLOR_TYPE_GRAY, rows, PNG_INTERLACE_ADAM7);
  const ColorImage image = ReadColorImage(folder() / "a.png");
  for (int row = 0; row < 9; ++row) {
    for (int col = 0; col < 11; ++col) EXPECT_EQ(image(col, row).g, 20 * row + col);
  }
}

TEST_F(ImageCodecTest, EveryTruncationIsRefused) {
  WritePng(folder() / "whole.png", RandomColors(20, 20));
  WriteColorImage(folder() / "whole.jpg", RandomColors(40, 40));
  for (const char* name : {"whole.png", "whole.jpg"}) {
    const std::string whole = ReadText(folder() / name);
    for (size_t length = 0; length < whole.size(); length += std::max<size_t>(1, whole.size() / 61)) {
      const auto path = WriteText("cut", whole.substr(0, length));
      EXPECT_REFUSED(ReadColorImage(path), path.string()) << name << " cut to " << length;
    }
  }
}

TEST_F(ImageCodecTest, HarmlessOdditiesOfJpegAreRead) {
  const ColorImage image = SmoothColors(40, 40);
  WriteColorImage(folder() / "whole.jpg", image);
  const std::string whole = ReadText(folder() / "whole.jpg");
  const size_t scan = whole.find("\xff\xda"), jfif = whole.find("JFIF");
  ASSERT_NE(scan, std::string::npos);
  ASSERT_NE(jfif, std::string::npos);
  std::map<std::string, std::string> odd = {{"nothing odd", whole}};
  odd["stray bytes"] = std::string(whole).insert(scan, "abc");
  odd["a scan to coefficient 0, as phones write it"] = whole;
  odd["a scan to coefficient 0, as phones write it"][scan + 12] = 0;
  odd["another JFIF"] = whole;
  odd["another JFIF"][jfif + 5] = 2;
  for (const auto& oddity : odd) {
    const std::string &what = oddity.first, &content = oddity.second;  // clang lets no lambda have structured bindings
    // A video behind the image may have any bytes.
    for (const std::string& behind : {std::string(), "abc\xff\xda" + std::string(9, 'x')}) {
      EXPECT_EQ(MaxDifference(DecodeColorImage(what, content + behind), DecodeColorImage("whole", whole)), 0) << what;
    }
    EXPECT_REFUSED(DecodeColorImage(what, content.substr(0, content.size() * 9 / 10)), what + ": damaged");
  }
}

TEST_F(ImageCodecTest, AJpegOfEndlessScansIsRefusedBeforeTheyAreDecoded) {
  WriteColorImage(folder() / "whole.jpg", SmoothColors(40, 40));
  std::string content = ReadText(folder() / "whole.jpg");
  const std::string scan =
      content.substr(content.find("\xff\xda"), content.rfind("\xff\xd9") - content.find("\xff\xda"));
  for (int i = 0; i < 100; ++i) content.insert(content.find("\xff\xda"), scan);
  EXPECT_REFUSED(DecodeColorImage("a.jpg", content), "a.jpg", "101 scans: at most 100");
}

TEST_F(ImageCodecTest, GrayJpegBecomesRgbAndFourColoursAreRefused) {
  WriteJpeg(folder() / "a.jpg", 16, TJPF_GRAY, TJSAMP_GRAY, std::vector<unsigned char>(16 * 16, 76));
  const Rgb pixel = ReadColorImage(folder() / "a.jpg")(8, 8);
  EXPECT_THAT((std::vector<int>{pixel.r, pixel.g, pixel.b}), Each(76));
  WriteJpeg(folder() / "a.jpg", 8, TJPF_CMYK, TJSAMP_444, std::vector<unsigned char>(4 * 8 * 8, 76));
  EXPECT_REFUSED(ReadColorImage(folder() / "a.jpg"), "4 colours (CMYK)");
}

TEST_F(ImageCodecTest, DamagedChecksumIsRefused) {
  WritePng(folder() / "a.png", RandomColors(20, 20));
  std::string content = ReadText(folder() / "a.png");
  content[content.size() / 2] ^= 0x55;
  EXPECT_REFUSED(ReadColorImage(WriteText("b.png", content)), "damaged PNG");
}

TEST_F(ImageCodecTest, HugeHeaderIsRefusedBeforeMemoryIsTaken) {
  WriteColorImage(folder() / "a.jpg", SmoothColors(16, 16));
  std::string content = ReadText(folder() / "a.jpg");
  const size_t frame = content.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  content.replace(frame + 5, 4, "\xff\xff\xff\xff");  // height and width 65535
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { ReadColorImage(WriteText("b.jpg", content)); }),
              AnyOf(HasSubstr("65535 x 65535"), HasSubstr("Maximum supported image dimension")));
}

TEST_F(ImageCodecTest, MissingFolderAndOtherKindsAreNamed) {
  EXPECT_REFUSED(ReadColorImage(folder() / "none.png"), "none.png", "No such file");
  EXPECT_REFUSED(ReadColorImage(folder()), "is a folder");
  EXPECT_REFUSED(ReadColorImage(WriteText("a.txt", "hello")), "neither a PNG nor a JPEG");
}

}  // namespace
}  // namespace acmp
