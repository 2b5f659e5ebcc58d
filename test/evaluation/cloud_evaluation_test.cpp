#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

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
    mesh.vertices.push_back({{x, y, 2}, {0, 0, -1}, {1, 2, 3}, 0, 1});
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

constexpr int kWidth = 40, kHeight = 32;
constexpr double kVoxel = 0.1;

// A synthetic scene whose true maps have holes, and a reconstruction of points on, in front of and behind surfaces.
class EvaluateCloudTest : public TestFolder {
 protected:
  EvaluateCloudTest() {
    WriteSceneFiles(folder() / "scene", views_, 0.5f);
    std::filesystem::create_directories(folder() / "truth");
    for (size_t i = 0; i < views_.size(); ++i) {
      truth_.push_back(views_[i].true_depth.Clone());
      for (int row = 0; row < kHeight / 3; ++row) std::fill_n(&truth_[i](0, row), kWidth, 0.0f);
      WritePfm(folder() / "truth" / ("00000" + std::to_string(i) + ".pfm"), truth_[i]);
    }
    MakeReconstruction();
    WritePly(folder() / "cloud.ply", cloud_);
  }

  void MakeReconstruction() {
    for (size_t i = 0; i < 600; ++i) {
      RandomStream random(3, static_cast<uint32_t>(i), 0);
      const SyntheticView& view = views_[i % views_.size()];
      const int col = static_cast<int>(random.NextUniform() * kWidth), row = static_cast<int>(i) % kHeight;
      const double depth = view.true_depth(col, row) + random.NextUniform(-0.4f, 0.4f);
      const Eigen::Vector3d p = view.frame.cam_from_world.inverse() * view.frame.camera.Unproject({col, row}, depth);
      SurfacePoint point = {};
      point.position = {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
      cloud_.push_back(point);
    }
  }

  CloudEvaluationOptions Options() const {
    CloudEvaluationOptions options;
    options.reconstruction = folder() / "cloud.ply";
    options.ground_truth = folder() / "scene";
    options.truth.folder = (folder() / "truth").string();
    options.thresholds = {0.05, 0.2};
    options.voxel_size = kVoxel;
    return options;
  }

  const std::vector<SyntheticView> views_ = MakeSyntheticScene({kWidth, kHeight, 3});
  std::vector<DepthMap> truth_;
  PointCloud cloud_;
};

TEST_F(EvaluateCloudTest, IsThatOfTheMapsAndThePoints) {
  const CloudEvaluation evaluation = EvaluateCloudFile(Options());
  ObservedSurface surface(cloud_, kVoxel / 2, 0.2);
  const std::vector<ListedCamera> cameras = ReadCameraList(folder() / "scene/cameras.txt");
  for (size_t i = 0; i < views_.size(); ++i) {
    surface.Add(truth_[i], cameras[i].camera, cameras[i].world_from_cam.inverse());
  }
  const std::vector<uint8_t>& observed = surface.observed();
  const auto judged = static_cast<size_t>(std::count(observed.begin(), observed.end(), 1));
  EXPECT_EQ(evaluation.reconstructed_points, cloud_.size());
  EXPECT_EQ(evaluation.observed_points, judged);
  EXPECT_LT(judged, cloud_.size() - 100);  // behind surfaces and in the holes
  EXPECT_GT(judged, 100u);
  EXPECT_EQ(evaluation.true_points, surface.cloud().size());
  EXPECT_EQ(evaluation.true_maps, 3u);
  const std::vector<CloudMetrics> expected =
      EvaluateCloud(cloud_, surface.cloud(), Options().thresholds, kVoxel, observed);
  ASSERT_EQ(evaluation.metrics.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(evaluation.metrics[i].accuracy, expected[i].accuracy);
    EXPECT_EQ(evaluation.metrics[i].completeness, expected[i].completeness);
    EXPECT_GT(expected[i].accuracy, 5);
    EXPECT_LT(expected[i].accuracy, 95);
  }
  EXPECT_EQ(nlohmann::json::parse(CloudJson(evaluation))["metrics"][1]["accuracy"], expected[1].accuracy);
}

TEST_F(EvaluateCloudTest, HonoursMaxDepthAndTheUnitOfPngFiles) {
  CloudEvaluationOptions options = Options();
  options.truth.folder = "depth";  // the scene's own, without holes
  const CloudEvaluation whole = EvaluateCloudFile(options);
  options.truth.max_depth = 2.0;
  const CloudEvaluation near = EvaluateCloudFile(options);
  EXPECT_LT(near.true_points, whole.true_points);
  EXPECT_LT(near.observed_points, whole.observed_points);
  options.truth.max_depth = 0;
  options.truth.png_unit = 500.0;  // all depths twice as large
  EXPECT_LT(EvaluateCloudFile(options).metrics[1].accuracy, whole.metrics[1].accuracy / 2);
}

TEST_F(EvaluateCloudTest, AgainstACloudEveryPointCounts) {
  CloudEvaluationOptions options = Options();
  options.ground_truth = folder() / "half.ply";
  WritePly(options.ground_truth, PointCloud(cloud_.begin(), cloud_.begin() + 300));
  const CloudEvaluation evaluation = EvaluateCloudFile(options);
  EXPECT_EQ(evaluation.observed_points, cloud_.size());
  EXPECT_EQ(evaluation.true_maps, 0u);
  EXPECT_EQ(evaluation.metrics[0].completeness, 100.0);
  EXPECT_LT(evaluation.metrics[0].accuracy, 90.0);
}

TEST_F(EvaluateCloudTest, FarFromTheOriginItIsTheSame) {
  const Eigen::Vector3d utm(500000, 5400000, 400);
  PointCloud moved = cloud_;
  for (SurfacePoint& point : moved) point.position.x += 0.03f;
  CloudEvaluationOptions options = Options();
  const auto f1 = [&](const Eigen::Vector3d& origin) {
    options.reconstruction = folder() / "moved.ply";
    options.ground_truth = folder() / "there.ply";
    WritePly(options.reconstruction, moved, origin);
    WritePly(options.ground_truth, cloud_, origin);
    return EvaluateCloudFile(options).metrics[0].f1;
  };
  EXPECT_NEAR(f1(utm), f1(Eigen::Vector3d::Zero()), 0.5) << "voxels have other borders";
}

}  // namespace
}  // namespace acmp
