#include "acmp_mapping/fusion/voxel_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "fusion/error_text.h"

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
    std::array<double, 9> values{};  // position, normal, colour
  };
  std::map<std::array<long, 3>, Sum> sums;
  for (const SurfacePoint& p : points) {
    const auto cell = [&](float x) { return std::lround(std::floor(static_cast<double>(x) / size)); };
    Sum& sum = sums[{cell(p.position.x), cell(p.position.y), cell(p.position.z)}];
    const double values[9] = {p.position.x,
                              p.position.y,
                              p.position.z,
                              p.normal.x,
                              p.normal.y,
                              p.normal.z,
                              static_cast<double>(p.color.r),
                              static_cast<double>(p.color.g),
                              static_cast<double>(p.color.b)};
    for (int i = 0; i < 9; ++i) sum.values[i] += p.confidence * values[i];
    sum.weight += p.confidence;
    sum.confidence += p.confidence * p.confidence;
  }
  const PointCloud filtered = VoxelFilter(points, size);
  ASSERT_EQ(filtered.size(), sums.size());
  ASSERT_LT(filtered.size(), 4200u);
  size_t i = 0;
  for (const auto& [cell, sum] : sums) {  // the map is in the order of coordinates, too
    const SurfacePoint& p = filtered[i++];
    const double normal_length = std::hypot(sum.values[3], sum.values[4], sum.values[5]);
    // Values up to 1 rounded to float once.
    ASSERT_NEAR(p.position.x, sum.values[0] / sum.weight, 1e-6);
    ASSERT_NEAR(p.position.y, sum.values[1] / sum.weight, 1e-6);
    ASSERT_NEAR(p.position.z, sum.values[2] / sum.weight, 1e-6);
    ASSERT_NEAR(p.normal.x, sum.values[3] / normal_length, 1e-6);
    ASSERT_NEAR(p.normal.y, sum.values[4] / normal_length, 1e-6);
    ASSERT_NEAR(p.normal.z, sum.values[5] / normal_length, 1e-6);
    ASSERT_NEAR(p.color.r, sum.values[6] / sum.weight, 0.5 + 1e-6);
    ASSERT_NEAR(p.color.g, sum.values[7] / sum.weight, 0.5 + 1e-6);
    ASSERT_NEAR(p.color.b, sum.values[8] / sum.weight, 0.5 + 1e-6);
    ASSERT_NEAR(p.confidence, sum.confidence / sum.weight, 1e-6);
  }
}

SurfacePoint Point(float x, float normal_z, float confidence) {
  return {{x, 0.5f, 0.5f}, {0, 0, normal_z}, {100, 0, 0}, confidence};
}

TEST(VoxelFilter, SeparatesVoxelsAtTheirBordersAndBelowZero) {
  EXPECT_EQ(VoxelFilter({Point(0.0f, 1, 1), Point(0.999f, 1, 1)}, 1).size(), 1u);
  EXPECT_EQ(VoxelFilter({Point(0.999f, 1, 1), Point(1.0f, 1, 1)}, 1).size(), 2u);
  EXPECT_EQ(VoxelFilter({Point(-0.1f, 1, 1), Point(0.1f, 1, 1)}, 1).size(), 2u);  // not rounded towards zero
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

TEST(VoxelFilter, HandlesEmptyCloudsAndRefusesBadInput) {
  EXPECT_TRUE(VoxelFilter({}, 0.1f).empty());
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const float size : {0.0f, -1.0f, nan, infinity}) {
    EXPECT_THAT(ErrorOf([&] { VoxelFilter({}, size); }), testing::HasSubstr("voxel size"));
  }
  for (const float x : {nan, infinity, 1e12f}) {
    EXPECT_THAT(ErrorOf([&] { VoxelFilter({Point(0, 1, 1), Point(x, 1, 1)}, 0.1f); }), testing::HasSubstr("point 1"));
  }
  for (const float confidence : {nan, -0.1f, 1.1f}) {
    EXPECT_THAT(ErrorOf([&] { VoxelFilter({Point(0, 1, confidence)}, 0.1f); }), testing::HasSubstr("confidence"));
  }
}

TEST(VoxelFilter, DoesNotDependOnTheNumberOfThreads) {
  const PointCloud points = RandomCloud(20000, 3);
  std::vector<PointCloud> clouds;
  for (const size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    clouds.push_back(VoxelFilter(points, 0.3f));
  }
  ASSERT_EQ(clouds[0].size(), clouds[1].size());
  for (size_t i = 0; i < clouds[0].size(); ++i) {
    ASSERT_EQ(clouds[0][i].position.x, clouds[1][i].position.x);
    ASSERT_EQ(clouds[0][i].normal.y, clouds[1][i].normal.y);
    ASSERT_EQ(clouds[0][i].confidence, clouds[1][i].confidence);
  }
}

TEST(Transform, MovesPointsAndTurnsNormals) {
  RigidTransform quarter_turn = RigidTransform::Identity();  // x -> y, y -> -x
  quarter_turn.linear() << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  quarter_turn.translation() = Eigen::Vector3d(10, 20, 30);
  const PointCloud points = {{{1, 2, 3}, {1, 0, 0}, {4, 5, 6}, 0.7f}};
  const PointCloud moved = Transform(quarter_turn, points);
  ASSERT_EQ(moved.size(), 1u);
  EXPECT_EQ(moved[0].position.x, 8);
  EXPECT_EQ(moved[0].position.y, 21);
  EXPECT_EQ(moved[0].position.z, 33);
  EXPECT_EQ(moved[0].normal.x, 0);
  EXPECT_EQ(moved[0].normal.y, 1);
  EXPECT_EQ(moved[0].color.g, 5);
  EXPECT_EQ(moved[0].confidence, 0.7f);
  EXPECT_TRUE(Transform(quarter_turn, {}).empty());
}

}  // namespace
}  // namespace acmp
