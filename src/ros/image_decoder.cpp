#include "acmp_mapping/ros/image_decoder.h"

#include <algorithm>
#include <string_view>

#include <sensor_msgs/image_encodings.h>
#include <opencv2/core.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"

namespace acmp {
namespace {

bool IsGrey(const ColorImage& image) {
  return std::all_of(image.begin(), image.end(), [](const Rgb& p) { return p.r == p.g && p.g == p.b; });
}

}  // namespace

cv::Mat ImageDecoder::Decode(const EncodedImage& image, const PinholeCamera* camera) {
  if (image.compressed) return DecodeCompressed(*image.compressed, camera);
  const sensor_msgs::Image& raw = *image.raw;
  return raw_.Decode({raw.encoding, raw.width, raw.height, raw.step, raw.is_bigendian != 0,
                      std::string_view(reinterpret_cast<const char*>(raw.data.data()), raw.data.size())});
}

cv::Mat ImageDecoder::DecodeCompressed(const sensor_msgs::CompressedImage& image, const PinholeCamera* camera) {
  const std::string name = Concat("compressed image of ", image.data.size(), " bytes, format \"", image.format, "\"");
  const std::string_view content(reinterpret_cast<const char*>(image.data.data()), image.data.size());
  const ImageSize size = EncodedImageSize(name, content);
  if (camera && (size.width != camera->width || size.height != camera->height)) {
    throw InvalidInputError(Concat(name, ": its header says ", size.width, "x", size.height, ", camera_info says ",
                                   camera->width, "x", camera->height));
  }
  // image_transport: "bayer_rggb8; jpeg compressed ", where the picture is the mosaic.
  const std::string encoding = image.format.substr(0, std::min(image.format.find(';'), image.format.size()));
  const std::string eight_bits = WithEightBits(encoding);
  const bool mosaic = sensor_msgs::image_encodings::isBayer(encoding);
  if (IsPng16(content)) {
    Image<uint16_t> grey = DecodePng16(name, content);
    return raw_.Convert(name, mosaic && !eight_bits.empty() ? encoding : "mono16",
                        cv::Mat(grey.height(), grey.width(), CV_16U, grey.data()));
  }
  ColorImage rgb = DecodeColorImage(name, content);
  const cv::Mat pixels(rgb.height(), rgb.width(), CV_8UC3, rgb.data());
  if (!mosaic || !IsGrey(rgb)) return pixels.clone();
  cv::Mat grey;
  cv::extractChannel(pixels, grey, 0);
  return raw_.Convert(name, eight_bits.empty() ? encoding : eight_bits, grey);
}

}  // namespace acmp
