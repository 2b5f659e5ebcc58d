#include "acmp_mapping/dataset/raw_image.h"

#include <algorithm>
#include <cctype>
#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// An encoding of 8 bits and what makes RGB of it.
struct PixelFormat {
  const char* name;
  int channels;
  int conversion;                   ///< of cv::cvtColor
  const char* taken_for = nullptr;  ///< what the name leaves open; null: nothing
  int chroma_planes = 0;            ///< below the grey image, a quarter of its pixels for each colour (YUV 4:2:0)
};

constexpr int kUnchanged = -1;
// OpenCV names a Bayer pattern after its second row and column. As 8UC* cv_bridge names OpenCV's images when it is not
// told more; OpenCV has blue first.
constexpr PixelFormat kFormats[] = {{"mono8", 1, cv::COLOR_GRAY2RGB},
                                    {"rgb8", 3, kUnchanged},
                                    {"bgr8", 3, cv::COLOR_BGR2RGB},
                                    {"rgba8", 4, cv::COLOR_RGBA2RGB},
                                    {"bgra8", 4, cv::COLOR_BGRA2RGB},
                                    {"bayer_rggb8", 1, cv::COLOR_BayerBG2RGB},
                                    {"bayer_bggr8", 1, cv::COLOR_BayerRG2RGB},
                                    {"bayer_gbrg8", 1, cv::COLOR_BayerGR2RGB},
                                    {"bayer_grbg8", 1, cv::COLOR_BayerGB2RGB},
                                    {"yuv422", 2, cv::COLOR_YUV2RGB_UYVY},
                                    {"uyvy", 2, cv::COLOR_YUV2RGB_UYVY},
                                    {"yuv422_yuy2", 2, cv::COLOR_YUV2RGB_YUY2},
                                    {"yuyv", 2, cv::COLOR_YUV2RGB_YUY2},
                                    {"nv12", 1, cv::COLOR_YUV2RGB_NV12, nullptr, 1},
                                    {"nv21", 1, cv::COLOR_YUV2RGB_NV21, nullptr, 1},
                                    {"i420", 1, cv::COLOR_YUV2RGB_I420, nullptr, 2},
                                    {"iyuv", 1, cv::COLOR_YUV2RGB_I420, nullptr, 2},
                                    {"yuv420", 1, cv::COLOR_YUV2RGB_I420, "i420", 2},
                                    {"yuv420p", 1, cv::COLOR_YUV2RGB_I420, "i420", 2},
                                    {"yv12", 1, cv::COLOR_YUV2RGB_YV12, nullptr, 2},
                                    {"8UC1", 1, cv::COLOR_GRAY2RGB, "mono8"},
                                    {"8UC3", 3, cv::COLOR_BGR2RGB, "bgr8"},
                                    {"8UC4", 4, cv::COLOR_BGRA2RGB, "bgra8"}};

bool IsSame(const std::string& a, const std::string& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
}

const PixelFormat& FindFormat(const std::string& name, const std::string& encoding) {
  for (const PixelFormat& format : kFormats) {
    if (IsSame(encoding, format.name)) return format;
  }
  const bool depth = encoding == "16UC1" || encoding == "32FC1";
  throw InvalidInputError(Concat(
      name, depth ? ": is it a depth map? It must be" : ": must be",
      " mono, rgb, bgr, rgba, bgra or bayer of 8 or 16 bits, yuv422 (uyvy), yuv422_yuy2 (yuyv), nv12, nv21, i420, "
      "yv12, 8UC1, 8UC3 or 8UC4; a grey image of 16 bits is mono16"));
}

/// As cv::Mat wants them; never written to.
uint8_t* BytesOf(const RawImage& raw) {
  return const_cast<uint8_t*>(reinterpret_cast<const uint8_t*>(raw.data.data()));
}

/// The grey image and below it the colours, in rows without gaps, as OpenCV takes YUV 4:2:0. In messages the height is
/// that of the image, or of all rows.
cv::Mat PackYuv420(const std::string& name, const RawImage& raw, int chroma_planes) {
  const uint64_t rows = 2 * uint64_t{raw.data.size()} / (3 * std::max<uint64_t>(raw.step, 1));
  const uint64_t needed = rows * raw.step + rows / 2 * raw.step;
  const uint64_t of_height = raw.height + uint64_t{raw.height} / 2;
  if ((rows != raw.height && rows + rows / 2 != raw.height) || needed != raw.data.size()) {
    throw InvalidInputError(Concat(name, ": must have ", of_height * raw.step, " bytes, one and a half of a pixel's"));
  }
  if (raw.width % 2 != 0 || rows % 2 != 0 || (chroma_planes == 2 && raw.step % 2 != 0)) {
    throw InvalidInputError(Concat(name, ": width, height and step must be even"));
  }
  if (raw.step < raw.width) throw InvalidInputError(Concat(name, ": must have a step of at least ", raw.width));
  const int width = static_cast<int>(raw.width), height = static_cast<int>(rows);
  auto* data = BytesOf(raw);
  cv::Mat packed(height + height / 2, width, CV_8U);
  cv::Mat(height, width, CV_8U, data, raw.step).copyTo(packed.rowRange(0, height));
  const int split = chroma_planes;  // two planes: two rows of colour in one of the grey image
  cv::Mat colours = packed.rowRange(height, packed.rows).reshape(1, split * height / 2);
  cv::Mat(colours.rows, colours.cols, CV_8U, data + rows * raw.step, raw.step / static_cast<size_t>(split))
      .copyTo(colours);
  return packed;
}

}  // namespace

cv::Mat RawImageDecoder::Decode(const RawImage& raw) {
  const std::string name = Concat("image encoding \"", raw.encoding, "\" (", raw.width, "x", raw.height, ", step ",
                                  raw.step, ", ", raw.data.size(), " bytes)");
  CheckImageSides(name, raw.width, raw.height);
  const std::string eight_bits = WithEightBits(raw.encoding);
  const PixelFormat& format = FindFormat(name, eight_bits.empty() ? raw.encoding : eight_bits);
  const uint64_t needed = uint64_t{raw.height} * raw.step;
  if (format.chroma_planes == 0 && raw.data.size() != needed) {
    throw InvalidInputError(Concat(name, ": must have ", needed, " bytes"));
  }
  if (format.taken_for) note_ = Concat("images of encoding \"", raw.encoding, "\" are taken for ", format.taken_for);
  if (format.chroma_planes > 0) return Convert(name, raw.encoding, PackYuv420(name, raw, format.chroma_planes));
  const uint64_t row_bytes = uint64_t{raw.width} * format.channels * (eight_bits.empty() ? 1 : 2);
  if (raw.step < row_bytes) throw InvalidInputError(Concat(name, ": must have a step of at least ", row_bytes));
  const int depth = eight_bits.empty() ? CV_8U : CV_16U;
  cv::Mat pixels(static_cast<int>(raw.height), static_cast<int>(raw.width), CV_MAKETYPE(depth, format.channels),
                 BytesOf(raw), raw.step);
  if (!eight_bits.empty() && raw.big_endian != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__)) {
    pixels = pixels.clone();
    for (auto* number = pixels.ptr<uint16_t>(); number != pixels.ptr<uint16_t>() + pixels.total() * format.channels;
         ++number) {
      *number = static_cast<uint16_t>(*number << 8 | *number >> 8);
    }
  }
  return Convert(name, raw.encoding, pixels);
}

cv::Mat RawImageDecoder::Convert(const std::string& name, const std::string& encoding, const cv::Mat& pixels) {
  const bool wide = pixels.depth() == CV_16U;
  const PixelFormat& format = FindFormat(name, wide ? WithEightBits(encoding) : encoding);
  if (format.channels == 2 && pixels.cols % 2 != 0) {
    throw InvalidInputError(Concat(name, ": a width of ", pixels.cols, " px: must be even"));
  }
  const cv::Mat narrow = wide ? ToEightBits(encoding, pixels) : pixels;
  if (format.conversion == kUnchanged) return narrow.clone();
  cv::Mat rgb;
  try {
    cv::cvtColor(narrow, rgb, format.conversion);
  } catch (const cv::Exception& error) {  // such as a mosaic of one pixel
    throw InvalidInputError(Concat(name, ": ", error.what()));
  }
  return rgb;
}

cv::Mat RawImageDecoder::ToEightBits(const std::string& encoding, const cv::Mat& pixels) {
  double most = 0;
  cv::minMaxIdx(pixels.reshape(1), nullptr, &most);
  while (used_bits_ < 16 && most >= 1 << used_bits_) ++used_bits_;
  note_.clear();
  if (used_bits_ < 16) {
    note_ = Concat("images of encoding \"", encoding, "\" use ", used_bits_,
                   " of their 16 bits, and the upper 8 of these are taken");
  }
  cv::Mat narrow(pixels.size(), CV_8UC(pixels.channels()));
  const int shift = used_bits_ - 8;
  for (int row = 0; row < pixels.rows; ++row) {
    const auto* from = pixels.ptr<uint16_t>(row);
    std::transform(from, from + pixels.cols * pixels.channels(), narrow.ptr<uint8_t>(row),
                   [shift](uint16_t value) { return static_cast<uint8_t>(value >> shift); });
  }
  return narrow;
}

std::string WithEightBits(const std::string& encoding) {
  const size_t base = encoding.size() - std::min<size_t>(encoding.size(), 2);
  return encoding.compare(base, 2, "16") == 0 ? encoding.substr(0, base) + "8" : "";
}

void CheckImageSides(const std::string& name, uint32_t width, uint32_t height) {
  constexpr int64_t kMaxImageSide = 32767;
  for (const uint32_t side : {width, height}) {
    CheckRange((name + ": width or height in px").c_str(), int64_t{side}, int64_t{1}, kMaxImageSide);
  }
}

}  // namespace acmp
