#pragma once

#include <string>

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <opencv2/core/mat.hpp>

#include "acmp_mapping/dataset/raw_image.h"
#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

/// One of the two messages is set. Shared with whoever published it: never written to.
struct EncodedImage {
  sensor_msgs::ImageConstPtr raw;
  sensor_msgs::CompressedImageConstPtr compressed;
  std::string topic = {};  ///< for messages; empty: unknown

  const std_msgs::Header& header() const { return raw ? raw->header : compressed->header; }
};

/// Makes 8-bit RGB of one camera's images: mono, RGB, BGR (also with alpha) and Bayer of 8 and 16 bits, YUV 4:2:2 and
/// 4:2:0, and PNG and JPEG of these. What an encoding leaves open is taken as most cameras mean it and told in `note`.
class ImageDecoder {
 public:
  /// Throws InvalidInputError that names the encoding when it is none of these, and what contradicts itself. The size
  /// in the header of a compressed image is read before memory is asked for: it must be at most kMaxImagePixels, and
  /// that of the camera, if there is one. An orientation in a JPEG's metadata is ignored, as frontends do.
  /// @param camera null: any size
  cv::Mat Decode(const EncodedImage& image, const PinholeCamera* camera = nullptr);

  /// What was assumed of the images so far; empty: nothing.
  const std::string& note() const { return raw_.note(); }

 private:
  cv::Mat DecodeCompressed(const sensor_msgs::CompressedImage& image, const PinholeCamera* camera);

  RawImageDecoder raw_;
};

}  // namespace acmp
