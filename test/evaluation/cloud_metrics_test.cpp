#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"

namespace acmp {
namespace {

SurfacePoint At(float x, float y, float z) {
  SurfacePoint point = {};
  point.position = {x, y, z};
  return point;
}

PointCloud RandomCloud(size_t count, float range, uint32_t seed) {
  PointCloud cloud;
  for (size_t i = 0; i < count; ++i) {
    RandomStream random(seed, static_cast<uint32_t>(i), 0);
    const float x = random.NextUniform(-range, range), y = random.NextUniform(-range, range);
    cloud.push_back(At(x, y, random.NextUniform(-range, range)));
  }
  return cloud;
}

// Brute force from the definition.
double Share(const PointCloud& points, const PointCloud& targets, double threshold, double voxel_size) {
  double sum = 0;
  size_t voxels = 0;
  for (const double shift : {0.0, 0.5}) {
    std::map<std::tuple<double, double, double>, std::pair<int, int>> grid;
    for (const SurfacePoint& p : points) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const SurfacePoint& t : targets) {
        const double dx = static_cast<double>(p.position.x) - t.position.x;
        const double dy = static_cast<double>(p.position.y) - t.position.y;
        const double dz = static_cast<double>(p.position.z) - t.position.z;
        nearest = std::min(nearest, std::sqrt(dx * dx + dy * dy + dz * dz));
      }
      auto& [within, count] =
          grid[{std::floor(p.position.x / voxel_size + shift), std::floor(p.position.y / voxel_size + shift),
                std::floor(p.position.z / voxel_size + shift)}];
      ++count;
      within += nearest <= threshold;
    }
    for (const auto& [voxel, counts] : grid) sum += static_cast<double>(counts.first) / counts.second;
    voxels += grid.size();
  }
  return 100.0 * sum / voxels;
}

TEST(EvaluateCloud, AgreesWithBruteForce) {
  const PointCloud reconstruction = RandomCloud(700, 0.5f, 1), ground_truth = RandomCloud(900, 0.55f, 2);
  const std::vector<double> thresholds = {0.05, 0.02, 0.2};  // in any order
  PointCloud judged;
  std::vector<uint8_t> observed(reconstruction.size());
  for (size_t i = 0; i < observed.size(); i += 2) {
    observed[i] = 1;
    judged.push_back(reconstruction[i]);
  }
  const auto metrics = EvaluateCloud(reconstruction, ground_truth, thresholds, 0.15, observed);
  ASSERT_EQ(metrics.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const double accuracy = Share(judged, ground_truth, thresholds[i], 0.15);
    const double completeness = Share(ground_truth, reconstruction, thresholds[i], 0.15);
    EXPECT_EQ(metrics[i].threshold, thresholds[i]);
    // Sums of about a thousand shares in another order.
    EXPECT_NEAR(metrics[i].accuracy, accuracy, 1e-9);
    EXPECT_NEAR(metrics[i].completeness, completeness, 1e-9);
    EXPECT_NEAR(metrics[i].f1, 2 * accuracy * completeness / (accuracy + completeness), 1e-9);
    EXPECT_GT(accuracy, 0);
  }
  EXPECT_GT(metrics[2].accuracy, metrics[0].accuracy);
  EXPECT_GT(metrics[0].accuracy, metrics[1].accuracy);
}

TEST(EvaluateCloud, DenseRegionsDoNotDominate) {
  // 99 right points in one voxel of either grid and a wrong one in another: half right, not 99 %.
  PointCloud reconstruction;
  for (int i = 0; i < 99; ++i) reconstruction.push_back(At(0.1f + 0.001f * i, 0.25f, 0.25f));
  reconstruction.push_back(At(10.25f, 0.25f, 0.25f));
  const PointCloud ground_truth = {At(0.15f, 0.25f, 0.25f)};
  const auto metrics = EvaluateCloud(reconstruction, ground_truth, {0.1}, 1.0);
  EXPECT_DOUBLE_EQ(metrics[0].accuracy, 50.0);
  EXPECT_DOUBLE_EQ(metrics[0].completeness, 100.0);
  EXPECT_NEAR(metrics[0].f1, 200.0 / 3.0, 1e-12);
}

TEST(EvaluateCloud, EqualPointsTakeNoLongerThanOthers) {
  PointCloud cloud = RandomCloud(20000, 1.0f, 3);
  const PointCloud truth = cloud;
  cloud.insert(cloud.end(), 200000, At(5, 5, 5));  // as depth cameras write points that they do not have; else minutes
  EXPECT_EQ(EvaluateCloud(cloud, truth, {1e-6}, 0.01)[0].completeness, 100.0);
  const PointCloud equal(400000, At(1, 1, 1));  // the nearest of all
  EXPECT_EQ(EvaluateCloud(equal, truth, {4.0}, 0.01)[0].completeness, 100.0);
}

using testing::ElementsAre;

// 4 x 3 px with a field of view of 90 degrees across; a pixel is half a metre wide at 1 m.
PinholeCamera WideCamera() { return {4, 3, 2, 2, 1.5, 1.0}; }

TEST(ObservedSurface, ObservesUpToTheSurfaceAndTheTolerance) {
  const float z = 2.0f;
  DepthMap depth(4, 3, z);
  depth(0, 0) = 0;
  depth(1, 0) = std::numeric_limits<float>::quiet_NaN();
  const auto at_pixel = [](float col, float row, float d) {
    return At((col - 1.5f) / 2.0f * d, (row - 1.0f) / 2.0f * d, d);
  };
  const PointCloud points = {
      at_pixel(2, 1, 0.5f),      // in front
      at_pixel(2, 1, z),         // on
      at_pixel(2, 1, 2.25f),     // behind, as far as the tolerance
      at_pixel(2, 1, 2.26f),     // hidden
      at_pixel(0, 0, 1.0f),      // unknown depth
      at_pixel(1, 0, 1.0f),      // the same, written as NaN
      at_pixel(2, 1, -1.0f),     // behind the camera
      at_pixel(3.49f, 1, 1.0f),  // the last column's outer half
      at_pixel(3.51f, 1, 1.0f),  // outside
      at_pixel(-0.5f, 1, 1.0f),  // the first column's outer border
      at_pixel(1.51f, 0, 1.0f),  // nearest to a known pixel
      at_pixel(1.49f, 0, 1.0f),  // nearest to an unknown one
  };
  ObservedSurface surface(points, 0.01, 0.25);
  surface.Add(depth, WideCamera(), RigidTransform::Identity());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 1, 1, 0, 0, 0, 0, 1, 0, 1, 1, 0));
  EXPECT_EQ(surface.cloud().size(), 10u);
}

TEST(ObservedSurface, OneMapThatObservesIsEnough) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.translation() = Eigen::Vector3d(0, 0, 10);
  world_from_cam.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()));  // looks back
  const PointCloud points = {At(0, 0, 1), At(0, 0, 5), At(0, 0, 9)};
  ObservedSurface surface(points, 0.01, 0.1);
  surface.Add(DepthMap(4, 3, 2.0f), WideCamera(), RigidTransform::Identity());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 0, 0));
  surface.Add(DepthMap(4, 3, 2.0f), WideCamera(), world_from_cam.inverse());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 0, 1));
}

TEST(ObservedSurface, KeepsTheFirstPointOfEachVoxel) {
  const PointCloud nothing;
  ObservedSurface surface(nothing, 0.35, 0.1);
  surface.Add(DepthMap(4, 3, 2.0f), WideCamera(), RigidTransform::Identity());
  const size_t first = surface.cloud().size();
  EXPECT_EQ(first, 12u) << "pixels are far apart";
  surface.Add(DepthMap(4, 3, 2.05f), WideCamera(), RigidTransform::Identity());
  surface.Add(DepthMap(4, 3, 2.3f), WideCamera(), RigidTransform::Identity());
  ASSERT_EQ(surface.cloud().size(), 2 * first);
  for (size_t i = 0; i < first; ++i) {
    EXPECT_EQ(surface.cloud()[i].position.z, 2.0f);
    EXPECT_EQ(surface.cloud()[first + i].position.z, 2.3f);
  }
}

TriangleMesh Square(float size) {
  TriangleMesh mesh;
  for (const auto& [x, y] : {std::pair{0.0f, 0.0f}, {size, 0.0f}, {size, size}, {0.0f, size}}) {
    mesh.vertices.push_back({{x, y, 2}, {0, 0, -1}, {1, 2, 3}, 1});
  }
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

TEST(SampleMesh, CoversTheSurface) {
  constexpr double kSpacing = 0.1;
  const PointCloud points = SampleMesh(Square(1), kSpacing);
  EXPECT_EQ(points.size(), 2u * 15 * 15) << "sqrt(2) / 0.1 is cut into 15 parts";
  for (float x = 0; x <= 1; x += 0.05f) {
    for (float y = 0; y <= 1; y += 0.05f) {
      double nearest = 1;
      for (const SurfacePoint& point : points) {
        nearest = std::min<double>(nearest, Norm(point.position - Vec3f{x, y, 2}));
      }
      EXPECT_LT(nearest, kSpacing) << x << ", " << y;
    }
  }
}

}  // namespace
}  // namespace acmp
