// An Image and a CompressedImage, of the camera's size or of any.

#include <boost/make_shared.hpp>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(image_message) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  if (bytes.TakeBool()) {
    const auto raw = boost::make_shared<sensor_msgs::Image>();
    fuzz::Fill(&bytes, raw.get());
    fuzz::MayRefuse([&] { DecodeRgb({raw, nullptr}, &camera); });
  } else {
    const auto compressed = boost::make_shared<sensor_msgs::CompressedImage>();
    fuzz::Fill(&bytes, compressed.get());
    fuzz::MayRefuse([&] { DecodeRgb({nullptr, compressed}, &camera); });
  }
  return 0;
}
