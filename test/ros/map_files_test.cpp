// Files of the map, read by PCL.

#include <filesystem>

#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>
#include <pcl/point_types.h>

#include "acmp_mapping/map/map_writer.h"
#include "ros/map_point.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

PointCloud MakeMap(int count) {
  PointCloud map;
  for (int i = 0; i < count; ++i) {
    map.push_back({{0.1f * static_cast<float>(i), -1.0f / 3, 1e-3f},
                   {0, 0.6f, -0.8f},
                   {200, 100, static_cast<unsigned char>(i)},
                   0.75f});
  }
  return map;
}

void ExpectSame(const pcl::PointCloud<pcl::PointXYZRGBNormal>& cloud, const PointCloud& map) {
  ASSERT_EQ(cloud.size(), map.size());
  for (size_t i = 0; i < map.size(); ++i) {
    EXPECT_EQ(cloud[i].x, map[i].position.x);
    EXPECT_EQ(cloud[i].y, map[i].position.y);
    EXPECT_EQ(cloud[i].z, map[i].position.z);
    EXPECT_EQ(cloud[i].normal_y, map[i].normal.y);
    EXPECT_EQ(cloud[i].normal_z, map[i].normal.z);
    EXPECT_EQ(cloud[i].r, map[i].color.r);
    EXPECT_EQ(cloud[i].g, map[i].color.g);
    EXPECT_EQ(cloud[i].b, map[i].color.b);
  }
}

TEST(MapFiles, PclReadsThem) {
  const fs::path folder = fs::path(testing::TempDir()) / "pcl_reads_map_files";
  fs::create_directories(folder);
  const PointCloud map = MakeMap(37);
  for (const bool binary : {true, false}) {
    pcl::PointCloud<pcl::PointXYZRGBNormal> cloud;
    const std::string ply = (folder / "map.ply").string();
    WriteMap(ply, {map}, MapFormat::kPly, binary);
    ASSERT_EQ(pcl::io::loadPLYFile(ply, cloud), 0);
    ExpectSame(cloud, map);
    const std::string pcd = (folder / "map.pcd").string();
    WriteMap(pcd, {map}, MapFormat::kPcd, binary);
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, cloud), 0);
    ExpectSame(cloud, map);
    pcl::PointCloud<MapPoint> all;
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, all), 0);
    ASSERT_EQ(all.size(), map.size());
    EXPECT_EQ(all[5].g, map[5].color.g);
    EXPECT_EQ(all[5].normal_z, map[5].normal.z);
    EXPECT_EQ(all[5].confidence, map[5].confidence);
    pcl::PointCloud<pcl::PointXYZRGBA> colors;  // some read the colours as whole numbers
    ASSERT_EQ(pcl::io::loadPCDFile(pcd, colors), 0);
    EXPECT_EQ(colors[5].g, map[5].color.g);
  }
}

}  // namespace
}  // namespace acmp
