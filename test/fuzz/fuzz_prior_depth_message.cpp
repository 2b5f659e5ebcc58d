// Depth from outside.

#include <boost/make_shared.hpp>

#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(prior_depth_message) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  const auto message = boost::make_shared<sensor_msgs::Image>();
  fuzz::Fill(&bytes, message.get());
  fuzz::MayRefuse([&] { DecodePriorDepth(*ToPriorDepthSample(message).image); });
  return 0;
}
