// A mask for a camera of 8 x 6 pixels.

#include <boost/make_shared.hpp>

#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(mask_message) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  const auto message = boost::make_shared<sensor_msgs::Image>();
  fuzz::Fill(&bytes, message.get());
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  fuzz::MayRefuse([&] { DecodeMask(*ToMaskSample(message).image, camera); });
  return 0;
}
