#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"

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

TEST(EvaluateCloud, CountsADistanceOfExactlyTheThreshold) {
  const auto metrics = EvaluateCloud({At(0.25f, 0, 0)}, {At(0, 0, 0)}, {0.25, 0.2499}, 0.01);
  EXPECT_EQ(metrics[0].accuracy, 100.0);
  EXPECT_EQ(metrics[1].accuracy, 0.0);
  EXPECT_EQ(metrics[1].f1, 0.0);
}

TEST(EvaluateCloud, EqualPointsTakeNoLongerThanOthers) {
  PointCloud cloud = RandomCloud(20000, 1.0f, 3);
  const PointCloud truth = cloud;
  cloud.insert(cloud.end(), 200000, At(5, 5, 5));  // as depth cameras write points that they do not have; else minutes
  EXPECT_EQ(EvaluateCloud(cloud, truth, {1e-6}, 0.01)[0].completeness, 100.0);
}

TEST(EvaluateCloud, RefusesBadInput) {
  const PointCloud cloud = {At(0, 0, 0)};
  EXPECT_THROW(EvaluateCloud(cloud, {}, {0.1}), InvalidInputError);
  EXPECT_THROW(EvaluateCloud(cloud, cloud, {0.0}), InvalidInputError);
  EXPECT_THROW(EvaluateCloud(cloud, cloud, {0.1}, -1.0), InvalidInputError);
  EXPECT_THROW(EvaluateCloud(cloud, cloud, {0.1}, std::nan("")), InvalidInputError);
  EXPECT_THROW(EvaluateCloud({At(std::nanf(""), 0, 0)}, cloud, {0.1}), InvalidInputError);
  EXPECT_THROW(EvaluateCloud({At(0, 1e30f, 0)}, cloud, {0.1}), InvalidInputError);
  EXPECT_THROW(EvaluateCloud(cloud, {At(0, 0, std::numeric_limits<float>::infinity())}, {0.1}), InvalidInputError);
}

}  // namespace
}  // namespace acmp
