#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

/// One of the two messages is set. Shared with whoever published it: never written to.
struct EncodedImage {
  sensor_msgs::ImageConstPtr raw;
  sensor_msgs::CompressedImageConstPtr compressed;
  std::string topic = {};  ///< for messages; empty: unknown

  const std_msgs::Header& header() const { return raw ? raw->header : compressed->header; }
};

/// Makes 8-bit RGB of one camera's images: mono, RGB, BGR (also with alpha) and Bayer of 8 and 16 bits, YUV 4:2:2, and
/// PNG and JPEG of these. What an encoding leaves open is taken as most cameras mean it and told in `note`.
class ImageDecoder {
 public:
  /// Throws InvalidInputError that names the encoding when it is none of these, and what contradicts itself. The size
  /// in the header of a compressed image is read before memory is asked for: it must be at most kMaxImagePixels, and
  /// that of the camera, if there is one. An orientation in a JPEG's metadata is ignored, as frontends do.
  /// @param camera null: any size
  cv::Mat Decode(const EncodedImage& image, const PinholeCamera* camera = nullptr);

  /// What was assumed of the images so far; empty: nothing.
  const std::string& note() const { return note_; }

 private:
  cv::Mat DecodeCompressed(const sensor_msgs::CompressedImage& image, const PinholeCamera* camera);
  /// Pixels in memory, with the bytes of each number as they are on this machine if it has 16 bits.
  cv::Mat Convert(const std::string& name, const std::string& encoding, const cv::Mat& pixels);
  /// The upper 8 of the bits that images use so far.
  cv::Mat ToEightBits(const std::string& encoding, const cv::Mat& pixels);

  int used_bits_ = 8;  ///< of 16, of the brightest pixel so far
  std::string note_;
};

/// The same of a single image.
cv::Mat DecodeRgb(const EncodedImage& image, const PinholeCamera* camera = nullptr);

/// What CheckImageSides does not refuse: 1 to 32767 px a side.
void CheckImageSides(const std::string& name, const sensor_msgs::Image& image);

bool IsBigEndianHost();

}  // namespace acmp
