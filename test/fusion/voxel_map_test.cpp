#include "acmp_mapping/fusion/voxel_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <random>

#include "fusion/engine_views.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

PointCloud RandomCloud(int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> any(-1, 1), any_confidence(0, 1);
  std::uniform_int_distribution<int> any_color(0, 255);
  PointCloud points(count);
  for (SurfacePoint& point : points) {
    point.position = {any(generator), any(generator), any(generator)};
    point.normal = Normalized(Vec3f{any(generator), any(generator), 1.5f + any(generator)});
    point.color.r = static_cast<unsigned char>(any_color(generator));
    point.color.g = static_cast<unsigned char>(any_color(generator));
    point.color.b = static_cast<unsigned char>(any_color(generator));
    point.confidence = any_confidence(generator);
  }
  return points;
}

TEST(VoxelFilter, AgreesWithAPlainMap) {
  const PointCloud points = RandomCloud(5000, 1);
  const float size = 0.13f;
  struct Sum {
    double weight = 0, confidence = 0;
    Eigen::Vector3d position = {0, 0, 0}, normal = {0, 0, 0}, color = {0, 0, 0};
  };
  std::map<std::array<long, 3>, Sum> sums;
  for (const SurfacePoint& p : points) {
    const auto cell = [&](float x) { return std::lround(std::floor(static_cast<double>(x) / size)); };
    Sum& sum = sums[{cell(p.position.x), cell(p.position.y), cell(p.position.z)}];
    sum.position += p.confidence * Eigen::Vector3d(p.position.x, p.position.y, p.position.z);
    sum.normal += p.confidence * Eigen::Vector3d(p.normal.x, p.normal.y, p.normal.z);
    sum.color += p.confidence * Eigen::Vector3d(p.color.r, p.color.g, p.color.b);
    sum.weight += p.confidence;
    sum.confidence += p.confidence * p.confidence;
  }
  const PointCloud filtered = VoxelFilter(points, size);
  ASSERT_EQ(filtered.size(), sums.size());
  ASSERT_LT(filtered.size(), 4200u);
  size_t i = 0;
  for (const auto& [cell, sum] : sums) {  // the map is in the order of coordinates, too
    const SurfacePoint& p = filtered[i++];
    reference::ExpectNear(
        p, {sum.position / sum.weight, sum.normal.normalized(), sum.color / sum.weight, sum.confidence / sum.weight});
  }
}

SurfacePoint Point(float x, float normal_z, float confidence) {
  return {{x, 0.5f, 0.5f}, {0, 0, normal_z}, {100, 0, 0}, confidence};
}

TEST(MergeClouds, IsTheVoxelFilterOfTheMovedClouds) {
  // Turned and shifted clouds, one of them empty, so that voxels mix points of several clouds.
  const std::vector<PointCloud> clouds = {RandomCloud(3000, 5), {}, RandomCloud(2000, 6), RandomCloud(1000, 7)};
  std::vector<PlacedCloud> placed;
  PointCloud together;
  for (size_t i = 0; i < clouds.size(); ++i) {
    RigidTransform pose = RigidTransform::Identity();
    pose.rotate(Eigen::AngleAxisd(0.4 * static_cast<double>(i), Eigen::Vector3d(1, 2, 3).normalized()));
    pose.translation() = Eigen::Vector3d(0.3, -0.2, 0.1) * static_cast<double>(i);
    placed.push_back({pose, &clouds[i]});
    for (SurfacePoint point : clouds[i]) {
      const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
      const Eigen::Vector3d normal(point.normal.x, point.normal.y, point.normal.z);
      const Eigen::Vector3f moved = (pose * position).cast<float>(), turned = (pose.linear() * normal).cast<float>();
      point.position = {moved.x(), moved.y(), moved.z()};
      point.normal = {turned.x(), turned.y(), turned.z()};
      together.push_back(point);
    }
  }
  const PointCloud expected = VoxelFilter(together, 0.2f), merged = MergeClouds(placed, 0.2f);
  EXPECT_EQ(FirstDifference(merged, expected), "");
  ASSERT_LT(merged.size(), together.size() * 3 / 4) << "voxels of several points";
  EXPECT_TRUE(MergeClouds({}, 0.1f).empty());
}

TEST(VoxelFilter, OrdersVoxelsOfAnyExtentByTheirCoordinates) {
  // A wall along each axis, scattered points far away (whose columns share a bucket), and one voxel for all.
  for (const Vec3f extent : {Vec3f{0, 50, 50}, Vec3f{50, 0, 50}, Vec3f{50, 50, 0}, Vec3f{2e9f, 2e9f, 2e9f},
                             Vec3f{2e9f, 0, 0}, Vec3f{0.1f, 0.1f, 0.1f}}) {
    PointCloud points = RandomCloud(20000, 8);
    for (SurfacePoint& point : points) {
      point.position = {point.position.x * extent.x, point.position.y * extent.y, point.position.z * extent.z};
    }
    std::map<std::array<double, 3>, int> voxels;
    const auto cell = [](const SurfacePoint& p) -> std::array<double, 3> {
      return {std::floor(p.position.x), std::floor(p.position.y), std::floor(p.position.z)};
    };
    for (const SurfacePoint& point : points) ++voxels[cell(point)];
    const PointCloud filtered = VoxelFilter(points, 1);
    ASSERT_EQ(filtered.size(), voxels.size());
    auto expected = voxels.begin();
    for (const SurfacePoint& mean : filtered) {
      if (expected->second == 1) {  // a mean of several may be rounded across the border
        ASSERT_EQ(cell(mean), expected->first);
      }
      ++expected;
    }
  }
}

TEST(VoxelFilter, AveragesPlainlyWhenNothingIsConfident) {
  const PointCloud filtered = VoxelFilter({Point(0.1f, 1, 0), Point(0.3f, 1, 0)}, 1);
  ASSERT_EQ(filtered.size(), 1u);
  EXPECT_NEAR(filtered[0].position.x, 0.2, 1e-6);
  EXPECT_EQ(filtered[0].confidence, 0);
  // One confident point outweighs any number of others.
  const PointCloud weighted = VoxelFilter({Point(0.1f, 1, 0), Point(0.3f, 1, 0.5f), Point(0.2f, 1, 0)}, 1);
  EXPECT_NEAR(weighted.at(0).position.x, 0.3, 1e-6);
}

TEST(VoxelFilter, KeepsTheStrongestNormalWhenNormalsCancel) {
  const PointCloud filtered = VoxelFilter({Point(0.1f, 1, 0.25f), Point(0.2f, -1, 0.5f), Point(0.3f, 1, 0.25f)}, 1);
  ASSERT_EQ(filtered.size(), 1u);
  EXPECT_EQ(filtered[0].normal.z, -1);
}

}  // namespace
}  // namespace acmp
