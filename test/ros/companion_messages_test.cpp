// Masks and depth from outside.

#include <cmath>
#include <cstring>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <class T>
boost::shared_ptr<sensor_msgs::Image> MakeMessage(const std::string& encoding, uint32_t width, uint32_t height,
                                                  uint32_t padding, const std::vector<T>& values) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = ros::Time(7, 8);
  message->encoding = encoding;
  message->width = width;
  message->height = height;
  message->step = width * sizeof(T) + padding;
  message->data.resize(static_cast<size_t>(message->step) * height, 99);
  for (uint32_t row = 0; row < height; ++row) {
    std::memcpy(message->data.data() + row * message->step, values.data() + row * width, width * sizeof(T));
  }
  return message;
}

std::vector<float> Decode(const sensor_msgs::ImageConstPtr& message) {
  const CompanionSample sample = ToPriorDepthSample(message);
  EXPECT_EQ(sample.stamp_ns, 7000000008);
  const DepthMap depth = DecodePriorDepth(*sample.image);
  EXPECT_EQ(depth.width(), static_cast<int>(message->width));
  return {depth.begin(), depth.end()};
}

TEST(MaskMessage, IsReadRowByRowWithoutPadding) {
  const PinholeCamera camera = {3, 2, 3, 3, 1, 0.5};
  for (const char* encoding : {"mono8", "8UC1"}) {
    const CompanionSample sample = ToMaskSample(MakeMessage<uint8_t>(encoding, 3, 2, 1, {0, 1, 255, 7, 0, 0}));
    EXPECT_EQ(sample.stamp_ns, 7000000008);
    const Mask mask = DecodeMask(*sample.image, camera);
    EXPECT_THAT(std::vector<unsigned char>(mask.begin(), mask.end()), ElementsAre(0, 1, 255, 7, 0, 0));
  }
  const CompanionSample turned = ToMaskSample(MakeMessage<uint8_t>("mono8", 2, 3, 0, {0, 1, 255, 7, 0, 0}));
  EXPECT_THAT(ErrorOf([&] { DecodeMask(*turned.image, camera); }), AllOf(HasSubstr("2x3"), HasSubstr("3x2")));
}

TEST(PriorDepthMessage, FloatIsReadAsItIsAndWhatIsNoDepthIsUnknown) {
  const auto message = MakeMessage<float>("32FC1", 3, 2, 4, {1.5f, NAN, -2, INFINITY, 0, 7});
  EXPECT_THAT(Decode(message), ElementsAre(1.5f, 0, 0, 0, 0, 7));
}

TEST(PriorDepthMessage, SixteenBitsAreThousandthsInEitherOrderOfBytes) {
  for (const char* encoding : {"16UC1", "mono16"}) {
    EXPECT_THAT(Decode(MakeMessage<uint16_t>(encoding, 2, 1, 0, {1500, 0})), ElementsAre(1.5f, 0));
  }
  const auto swapped = MakeMessage<uint16_t>("16UC1", 2, 1, 0, {0xdc05, 0});
  swapped->is_bigendian = 1;
  EXPECT_THAT(Decode(swapped), ElementsAre(1.5f, 0));
}

TEST(PriorDepthMessage, WithoutAnyDepthIsRefused) {
  const auto message = MakeMessage<float>("32FC1", 2, 1, 0, {NAN, -1});
  EXPECT_THAT(ErrorOf([&] { DecodePriorDepth(*ToPriorDepthSample(message).image); }), HasSubstr("no pixel"));
}

}  // namespace
}  // namespace acmp
