#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <Eigen/Geometry>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/packed_cloud.h"
#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp::test {
namespace {

/// Normals all over the sphere (a Fibonacci lattice), along the axes, and between them, where the octahedron has edges.
PointCloud AllDirections() {
  constexpr int kCount = 100000;
  constexpr double kGoldenAngle = 2.39996322972865332;
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < kCount; ++i) {
    const double z = 1 - (2 * i + 1.0) / kCount, radius = std::sqrt(1 - z * z);
    directions.emplace_back(radius * std::cos(kGoldenAngle * i), radius * std::sin(kGoldenAngle * i), z);
  }
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (x != 0 || y != 0 || z != 0) directions.push_back(Eigen::Vector3d(x, y, z).normalized());
      }
    }
  }
  PointCloud points;
  for (const Eigen::Vector3d& direction : directions) {
    const auto number = static_cast<unsigned>(points.size());
    const auto byte = [&](unsigned k) { return static_cast<unsigned char>(number * k >> 3); };
    points.push_back({{0.1f * static_cast<float>(number), -3e-20f, 7e20f},
                      ToVec3f(direction),
                      {byte(1), byte(3), byte(7)},
                      0,
                      static_cast<float>(number % 1009) / 1008});
  }
  return points;
}

bool HaveSameBits(const PointCloud& a, const PointCloud& b) {
  const auto same = [](const SurfacePoint& p, const SurfacePoint& q) {
    return std::memcmp(&p.position, &q.position, sizeof(p.position)) == 0 &&
           std::memcmp(&p.normal, &q.normal, sizeof(p.normal)) == 0 && ColorDistance(p.color, q.color) == 0 &&
           p.confidence == q.confidence;
  };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
}

TEST(PackedCloud, KeepsNormalsAndConfidencesToItsSteps) {
  const PointCloud given = AllDirections();
  const PackedCloud packed(given);
  ASSERT_EQ(packed.size(), given.size());
  constexpr double kMaxAngle_rad = 0.06 * M_PI / 180;
  double largest_rad = 0, largest_step = 0;
  for (size_t i = 0; i < given.size(); ++i) {
    const SurfacePoint point = packed[i];
    ASSERT_EQ(ToEigen(point.position), ToEigen(given[i].position));
    ASSERT_EQ(ColorDistance(point.color, given[i].color), 0);
    ASSERT_NEAR(ToEigen(point.normal).norm(), 1, 1e-6);
    const Eigen::Vector3d cross = ToEigen(point.normal).cross(ToEigen(given[i].normal));
    ASSERT_GT(ToEigen(point.normal).dot(ToEigen(given[i].normal)), 0) << i;
    largest_rad = std::max(largest_rad, cross.norm());
    largest_step = std::max(largest_step, std::abs(double{point.confidence} - given[i].confidence));
  }
  EXPECT_LT(largest_rad, kMaxAngle_rad);
  EXPECT_GT(largest_rad, kMaxAngle_rad / 2) << "the bound says what it costs";
  EXPECT_LE(largest_step, 0.5 / 65535 + 1e-7);  // and the rounding of float32
  EXPECT_EQ(packed[0].confidence, 0);
  EXPECT_EQ(packed[1008].confidence, 1);
}

TEST(PackedCloud, PackedAgainItStaysTheSame) {
  const PointCloud once = PackedCloud(AllDirections()).Unpack();
  EXPECT_TRUE(HaveSameBits(once, PackedCloud(once).Unpack()));
}

TEST(PackedCloud, WithoutADirectionThereIsNoNormal) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  for (const Vec3f& normal : {Vec3f{0, 0, 0}, Vec3f{kNaN, 0, 1}, Vec3f{0, 0, -kInfinity}}) {
    const SurfacePoint point = PackedCloud({{{1, 2, 3}, normal, {}, 0, 0.5f}})[0];
    EXPECT_EQ(ToEigen(point.normal), Eigen::Vector3d::Zero());
  }
  EXPECT_EQ(ToEigen(PackedCloud({{{1, 2, 3}, {0, -1e-9f, 0}, {}, 0, 0.5f}})[0].normal), Eigen::Vector3d(0, -1, 0));
}

TEST(PackedCloud, RefusesConfidencesThatAreNone) {
  for (const float bad : {-0.01f, 1.01f, std::numeric_limits<float>::quiet_NaN()}) {
    try {
      PackedCloud(PointCloud{{}, {{}, {}, {}, 0, bad}});
      ADD_FAILURE() << bad;
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("point 1"));
    }
  }
}

}  // namespace
}  // namespace acmp::test
