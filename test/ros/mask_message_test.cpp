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
using ::testing::HasSubstr;

const PinholeCamera kCamera = {3, 2, 3, 3, 1, 0.5};

boost::shared_ptr<sensor_msgs::Image> MakeMask(uint32_t width, uint32_t height, uint32_t step,
                                               std::vector<uint8_t> data) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = ros::Time(7, 8);
  message->encoding = "mono8";
  message->width = width;
  message->height = height;
  message->step = step;
  message->data = std::move(data);
  return message;
}

TEST(MaskMessage, IsReadRowByRowWithoutPadding) {
  const auto message = MakeMask(3, 2, 4, {0, 1, 255, 99, 7, 0, 0, 99});
  for (const char* encoding : {"mono8", "8UC1"}) {
    message->encoding = encoding;
    const CompanionSample sample = ToMaskSample(message);
    EXPECT_EQ(sample.stamp_ns, 7000000008);
    const Mask mask = DecodeMask(*sample.image, kCamera);
    ASSERT_EQ(mask.width(), 3);
    ASSERT_EQ(mask.height(), 2);
    EXPECT_THAT(std::vector<unsigned char>(mask.begin(), mask.end()), ::testing::ElementsAre(0, 1, 255, 7, 0, 0));
  }
}

TEST(MaskMessage, OfAnotherEncodingIsRefused) {
  const auto message = MakeMask(3, 2, 9, std::vector<uint8_t>(18));
  message->encoding = "rgb8";
  EXPECT_THAT(ErrorOf([&] { ToMaskSample(message); }),
              AllOf(HasSubstr("7.000000008"), HasSubstr("\"rgb8\""), HasSubstr("mono8")));
}

TEST(MaskMessage, WithTooFewBytesIsRefused) {
  EXPECT_THAT(ErrorOf([] { ToMaskSample(MakeMask(3, 2, 3, std::vector<uint8_t>(5))); }),
              AllOf(HasSubstr("5 bytes"), HasSubstr("needs 6")));
  EXPECT_THAT(ErrorOf([] { ToMaskSample(MakeMask(3, 2, 2, std::vector<uint8_t>(6))); }), HasSubstr("step 2"));
  EXPECT_THAT(ErrorOf([] { ToMaskSample(MakeMask(3, 4294967295u, 4294967295u, std::vector<uint8_t>(6))); }),
              HasSubstr("6 bytes"));
}

TEST(MaskMessage, OfAnotherSizeThanTheImagesIsRefused) {
  const CompanionSample sample = ToMaskSample(MakeMask(2, 3, 2, std::vector<uint8_t>(6)));
  EXPECT_THAT(ErrorOf([&] { DecodeMask(*sample.image, kCamera); }), AllOf(HasSubstr("2x3"), HasSubstr("3x2")));
}

}  // namespace
}  // namespace acmp
