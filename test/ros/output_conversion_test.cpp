#include "acmp_mapping/ros/output_conversion.h"

#include <cstring>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <pcl/point_types.h>
#include <pcl_conversions/pcl_conversions.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/map_writer.h"
#include "support/error_text.h"

namespace acmp {
namespace {

std_msgs::Header MakeHeader() {
  std_msgs::Header header;
  header.stamp = ros::Time(12, 345);
  header.frame_id = "cam";
  return header;
}

TEST(ToDepthMillimetres, RoundsAndLeavesOutWhatDoesNotFit) {
  DepthMap depth(4, 1, 0);
  depth(1, 0) = 1.5f;
  depth(2, 0) = 2.5f;
  depth(3, 0) = 70.0f;
  const Image<unsigned char> keep(4, 1, 1);
  const auto message = ToDepthMillimetres(*ToDepthMessage(depth, keep.View(), MakeHeader()));
  EXPECT_EQ(message->encoding, "16UC1");
  const auto* values = reinterpret_cast<const uint16_t*>(message->data.data());
  EXPECT_EQ(values[0], 0);
  EXPECT_EQ(values[1], 1500);
  EXPECT_EQ(values[2], 2500);
  EXPECT_EQ(values[3], 0) << "70 m is more than 65.535 m";
}

TEST(ToPointCloud, TurnsTheMessageBackWithoutAChange) {
  const PointCloud points = {{{1.0f / 3, -2, 3e-30f}, {0, 0.6f, -0.8f}, {1, 2, 255}, 0.7f},
                             {{4, 5, 6}, {1, 0, 0}, {255, 0, 9}, 0}};
  auto message = *ToCloudMessage(points, MakeHeader());
  const PointCloud back = ToPointCloud(message);
  ASSERT_EQ(back.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(back[i].position.x, points[i].position.x);
    EXPECT_EQ(back[i].position.y, points[i].position.y);
    EXPECT_EQ(back[i].position.z, points[i].position.z);
    EXPECT_EQ(back[i].normal.y, points[i].normal.y);
    EXPECT_EQ(back[i].color.r, points[i].color.r);
    EXPECT_EQ(back[i].color.g, points[i].color.g);
    EXPECT_EQ(back[i].color.b, points[i].color.b);
    EXPECT_EQ(back[i].confidence, points[i].confidence);
  }
  message.data.pop_back();
  EXPECT_THROW(ToPointCloud(message), InvalidInputError);
  EXPECT_THROW(ToPointCloud(sensor_msgs::PointCloud2()), InvalidInputError);
  message = *ToCloudMessage(points, MakeHeader());
  message.fields[3].name = "intensity";
  EXPECT_THROW(ToPointCloud(message), InvalidInputError);
}

TEST(ToCloudMessage, IsUnderstoodByPcl) {
  const PointCloud points = {{{1, 2, 3}, {0, 0.6f, -0.8f}, {200, 100, 50}, 0.75f},
                             {{4, 5, 6}, {1, 0, 0}, {1, 2, 3}, 1}};
  const auto message = ToCloudMessage(points, MakeHeader());
  ASSERT_EQ(message->fields.size(), 8u);
  EXPECT_EQ(message->fields[7].name, "confidence");
  float confidence;
  std::memcpy(&confidence, message->data.data() + message->fields[7].offset, sizeof(float));
  EXPECT_EQ(confidence, 0.75f);
  pcl::PointCloud<pcl::PointXYZRGBNormal> cloud;
  pcl::fromROSMsg(*message, cloud);
  ASSERT_EQ(cloud.size(), 2u);
  EXPECT_EQ(cloud[0].x, 1);
  EXPECT_EQ(cloud[0].r, 200);
  EXPECT_EQ(cloud[0].b, 50);
  EXPECT_EQ(cloud[0].normal_z, -0.8f);
  EXPECT_EQ(cloud[1].g, 2);
  EXPECT_EQ(ToCloudMessage({}, MakeHeader())->width, 0u);
}

TEST(CheckCloudSize, RefusesWhatAMessageCannotHold) {
  // 2^32 bytes and more: sizes in the message are 32-bit numbers and would wrap around.
  constexpr size_t kLimit = std::numeric_limits<uint32_t>::max();
  EXPECT_NO_THROW(CheckCloudSize(kLimit / kPackedPointBytes, kLimit));
  EXPECT_THAT(ErrorOf([] { CheckCloudSize(kLimit / kPackedPointBytes + 1, kLimit); }),
              testing::AllOf(testing::HasSubstr("134217728 points"), testing::HasSubstr("~voxel_size")));
}

}  // namespace
}  // namespace acmp
