#include "acmp_mapping/ros/output_conversion.h"

#include <cmath>
#include <cstring>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <image_geometry/pinhole_camera_model.h>
#include <pcl/point_types.h>
#include <pcl_conversions/pcl_conversions.h>
#include <sensor_msgs/image_encodings.h>

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

float FloatAt(const sensor_msgs::Image& image, size_t index) {
  float value;
  std::memcpy(&value, image.data.data() + index * sizeof(float), sizeof(float));
  return value;
}

DepthMap MakeDepth() {
  DepthMap depth(3, 2, 0);
  depth(1, 0) = 1.5f;
  depth(2, 0) = 2.5f;
  depth(0, 1) = 70.0f;
  return depth;
}

TEST(ToDepthMessage, MarksUnknownAndUnwantedPixelsAsNan) {
  Image<unsigned char> keep(3, 2, 1);
  keep(2, 0) = 0;
  const auto message = ToDepthMessage(MakeDepth(), keep.View(), MakeHeader());
  EXPECT_EQ(message->encoding, "32FC1");
  EXPECT_EQ(message->width, 3u);
  EXPECT_EQ(message->height, 2u);
  EXPECT_EQ(message->step, 12u);
  EXPECT_EQ(message->header.stamp, ros::Time(12, 345));
  EXPECT_EQ(message->header.frame_id, "cam");
  EXPECT_TRUE(std::isnan(FloatAt(*message, 0)));
  EXPECT_EQ(FloatAt(*message, 1), 1.5f);
  EXPECT_TRUE(std::isnan(FloatAt(*message, 2)));
  EXPECT_EQ(FloatAt(*message, 3), 70.0f);
}

TEST(ToDepthMillimetres, RoundsAndLeavesOutWhatDoesNotFit) {
  const Image<unsigned char> keep(3, 2, 1);
  const auto message = ToDepthMillimetres(*ToDepthMessage(MakeDepth(), keep.View(), MakeHeader()));
  EXPECT_EQ(message->encoding, "16UC1");
  const auto* values = reinterpret_cast<const uint16_t*>(message->data.data());
  EXPECT_EQ(values[0], 0);
  EXPECT_EQ(values[1], 1500);
  EXPECT_EQ(values[2], 2500);
  EXPECT_EQ(values[3], 0) << "70 m is more than 65.535 m";
}

TEST(ToNormalMessage, MarksUnknownPixelsAsNan) {
  NormalMap normal(2, 1, Vec3f{0, 0, 0});
  normal(1, 0) = {0, 0.6f, -0.8f};
  const Image<unsigned char> keep(2, 1, 1);
  const auto message = ToNormalMessage(normal, keep.View(), MakeHeader());
  EXPECT_EQ(message->encoding, "32FC3");
  EXPECT_TRUE(std::isnan(FloatAt(*message, 0)));
  EXPECT_EQ(FloatAt(*message, 4), 0.6f);
  EXPECT_EQ(FloatAt(*message, 5), -0.8f);
}

TEST(ToCameraInfo, IsUnderstoodByImageGeometry) {
  const PinholeCamera camera = {640, 480, 500, 510, 320.5, 240.5};
  image_geometry::PinholeCameraModel model;
  model.fromCameraInfo(ToCameraInfo(camera, MakeHeader()));
  EXPECT_EQ(model.fullResolution(), cv::Size(640, 480));
  const Eigen::Vector3d point(0.3, -0.2, 2);
  const cv::Point2d pixel = model.project3dToPixel({point.x(), point.y(), point.z()});
  EXPECT_NEAR(pixel.x, camera.Project(point).x(), 1e-9);
  EXPECT_NEAR(pixel.y, camera.Project(point).y(), 1e-9);
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
