#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <string_view>

namespace acmp {

/// Pixels as a camera's driver sends them, as in sensor_msgs/Image.
struct RawImage {
  std::string encoding;
  uint32_t width = 0, height = 0;  ///< px
  uint32_t step = 0;               ///< bytes of a row
  bool big_endian = false;         ///< of numbers of 16 bits
  std::string_view data;
};

/// Makes RGB (8 bits) of the images of one stream: mono, rgb, bgr, rgba, bgra and bayer mosaics of 8 or 16 bits, 4:2:2
/// (UYVY, YUY2) and 4:2:0 (NV12, NV21, I420, YV12) YUV, and OpenCV's 8UC1, 8UC3, 8UC4.
class RawImageDecoder {
 public:
  /// Throws InvalidInputError that names the encoding when it is none of these, and what contradicts itself.
  cv::Mat Decode(const RawImage& raw);
  /// The same of pixels in memory; numbers of 16 bits as this machine has them. @param name for messages
  cv::Mat Convert(const std::string& name, const std::string& encoding, const cv::Mat& pixels);

  /// What was assumed of the images so far; empty: nothing.
  const std::string& note() const { return note_; }

 private:
  /// The upper 8 of the bits that images use so far.
  cv::Mat ToEightBits(const std::string& encoding, const cv::Mat& pixels);

  int used_bits_ = 8;  ///< of 16, of the brightest pixel so far: cameras of 10 or 12 bits leave the upper ones 0
  std::string note_;
};

/// "mono8" for "mono16". Empty: the encoding has not 16 bits.
std::string WithEightBits(const std::string& encoding);

/// Throws InvalidInputError unless both are 1 to 32767 px: cv::remap, which rectifies images, has 16-bit coordinates.
void CheckImageSides(const std::string& name, uint32_t width, uint32_t height);

}  // namespace acmp
