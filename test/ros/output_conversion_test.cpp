// Messages and files of the map, as others read them.

#include "acmp_mapping/ros/output_conversion.h"

#include <cstring>
#include <filesystem>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>
#include <pcl/point_types.h>
#include <pcl_conversions/pcl_conversions.h>

#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/ros/map_output.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using PclCloud = pcl::PointCloud<pcl::PointXYZRGBNormal>;

TEST(ToDepthMillimetres, RoundsAndLeavesOutWhatDoesNotFit) {
  DepthMap depth(4, 1, 0);
  depth(1, 0) = 1.5f;
  depth(2, 0) = 2.5f;
  depth(3, 0) = 70.0f;  // more than 65.535 m
  const Image<unsigned char> keep(4, 1, 1);
  const auto message = ToDepthMillimetres(*ToDepthMessage(depth, keep.View(), std_msgs::Header()));
  EXPECT_EQ(message->encoding, "16UC1");
  const auto* values = reinterpret_cast<const uint16_t*>(message->data.data());
  EXPECT_THAT(std::vector<uint16_t>(values, values + 4), ::testing::ElementsAre(0, 1500, 2500, 0));
}

PointCloud MakePoints(int count, bool labels = false) {
  PointCloud points;
  for (int i = 0; i < count; ++i) {
    points.push_back({{0.1f * static_cast<float>(i), -1.0f / 3, 3e-30f},
                      {0, 0.6f, -0.8f},
                      {200, 100, static_cast<unsigned char>(i)},
                      labels ? static_cast<Label>(i % 3) : Label{0},
                      0.75f});
  }
  return points;
}

void ExpectSame(const PclCloud& cloud, const PointCloud& points) {
  ASSERT_EQ(cloud.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(std::memcmp(&cloud[i].x, &points[i].position, sizeof(Vec3f)), 0);
    EXPECT_EQ(std::memcmp(&cloud[i].normal_x, &points[i].normal, sizeof(Vec3f)), 0);
    EXPECT_EQ(cloud[i].r, points[i].color.r);
    EXPECT_EQ(cloud[i].g, points[i].color.g);
    EXPECT_EQ(cloud[i].b, points[i].color.b);
  }
}

TEST(Pcl, ReadsOurMessagesAndFiles) {
  const PointCloud points = MakePoints(37);
  const auto message = ToCloudMessage(points, std_msgs::Header());
  PclCloud cloud;
  pcl::fromROSMsg(*message, cloud);
  ExpectSame(cloud, points);
  EXPECT_EQ(message->fields.at(7).name, "confidence");
  float confidence;
  std::memcpy(&confidence, message->data.data() + message->fields[7].offset, sizeof(float));
  EXPECT_EQ(confidence, 0.75f);
  EXPECT_EQ(ToCloudMessage({}, std_msgs::Header())->width, 0u);
  const auto folder = std::filesystem::path(testing::TempDir()) / "pcl_reads_map_files";
  std::filesystem::create_directories(folder);
  for (const bool binary : {true, false}) {
    const std::string ply = (folder / "map.ply").string(), pcd = (folder / "map.pcd").string();
    WriteMap(ply, {points}, MapFormat::kPly, binary);
    ASSERT_EQ(pcl::io::loadPLYFile(ply, cloud), 0);
    ExpectSame(cloud, points);
    WriteMap(pcd, {points}, MapFormat::kPcd, binary);
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, cloud), 0);
    ExpectSame(cloud, points);
    pcl::PointCloud<pcl::PointXYZRGBA> colors;  // some read the colours as whole numbers
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, colors), 0);
    EXPECT_EQ(colors[5].g, points[5].color.g);
  }
}

TEST(Pcl, ReadsLabelsWherePointsHaveSome) {
  EXPECT_EQ(ToCloudMessage(MakePoints(3), std_msgs::Header())->point_step, 32u);
  const PointCloud points = MakePoints(7, true);
  const auto message = ToCloudMessage(points, std_msgs::Header());
  const auto expect_same = [&](const pcl::PointCloud<pcl::PointXYZRGBL>& cloud) {
    ASSERT_EQ(cloud.size(), points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(cloud[i].label, points[i].label);
      EXPECT_EQ(cloud[i].b, points[i].color.b);
    }
  };
  pcl::PointCloud<pcl::PointXYZRGBL> cloud;
  pcl::fromROSMsg(*message, cloud);
  expect_same(cloud);
  const auto folder = std::filesystem::path(testing::TempDir()) / "pcl_reads_labels";
  std::filesystem::create_directories(folder);
  for (const bool binary : {true, false}) {
    const std::string pcd = (folder / "map.pcd").string(), ply = (folder / "map.ply").string();
    WriteMap(pcd, {points}, MapFormat::kPcd, binary);
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, cloud), 0);
    expect_same(cloud);
    WriteMap(ply, {points}, MapFormat::kPly, binary);
    const PointCloud read = ReadPly(ply).vertices;
    ASSERT_EQ(read.size(), points.size());
    for (size_t i = 0; i < points.size(); ++i) EXPECT_EQ(read[i].label, points[i].label);
  }
  const PointCloud back = ToPointCloud(*message);
  for (size_t i = 0; i < points.size(); ++i) EXPECT_EQ(back.at(i).label, points[i].label);
  message->data.at(2 * message->point_step - 3) = 1;  // of the second point's label, 1 and 256
  EXPECT_REFUSED(ToPointCloud(*message), "point 1 = 257", "255");
}

TEST(CheckCloudSize, RefusesWhatAMessageCannotHold) {
  // 2^32 bytes and more: sizes in the message are 32-bit numbers and would wrap around.
  constexpr size_t kLimit = std::numeric_limits<uint32_t>::max();
  EXPECT_NO_THROW(CheckCloudSize(kLimit / 32, 32, kLimit));
  EXPECT_REFUSED(CheckCloudSize(kLimit / 32 + 1, 32, kLimit), "134217728 points", "~voxel_size");
}

/// /tf_static has no time: with one frame for all origins a cloud would move when its map's origin does, or another
/// map's.
TEST(LocalFrame, IsAnotherOneForAnotherOrigin) {
  const Eigen::Vector3d origin(499712, 5500928, 0.5);
  EXPECT_EQ(LocalFrame("utm", origin), "utm_map_origin_499712_5500928_0.5");
  EXPECT_NE(LocalFrame("utm", origin), LocalFrame("utm", origin + Eigen::Vector3d(0.5, 0, 0)));
}

}  // namespace
}  // namespace acmp
