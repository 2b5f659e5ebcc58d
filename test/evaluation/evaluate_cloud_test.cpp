#include <algorithm>
#include <filesystem>
#include "acmp_mapping/evaluation/evaluate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int kWidth = 40, kHeight = 32;
constexpr double kVoxel = 0.1;

// A synthetic scene whose true maps have holes, and a reconstruction of points on, in front of and behind surfaces.
class EvaluateCloudTest : public TestFolder {
 protected:
  EvaluateCloudTest() {
    WriteSceneFiles(folder() / "scene", views_, 0.5f);
    fs::create_directories(folder() / "truth");
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
  options.ground_truth = folder() / "cloud.ply";
  const CloudEvaluation evaluation = EvaluateCloudFile(options);
  EXPECT_EQ(evaluation.observed_points, cloud_.size());
  EXPECT_EQ(evaluation.true_maps, 0u);
  EXPECT_EQ(evaluation.metrics[0].f1, 100.0);
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

TEST_F(EvaluateCloudTest, ReportsTheSameFiguresInEveryForm) {
  const CloudEvaluation evaluation = EvaluateCloudFile(Options());
  const std::string table = CloudTable(evaluation);
  EXPECT_THAT(table,
              HasSubstr(std::to_string(evaluation.observed_points) + " of them where the ground truth observed"));
  EXPECT_THAT(table, HasSubstr("true points from 3 depth maps, voxels of 0.1"));
  const auto json = nlohmann::json::parse(CloudJson(evaluation));
  EXPECT_EQ(json["observed_points"], evaluation.observed_points);
  EXPECT_EQ(json["metrics"][1]["threshold"], evaluation.metrics[1].threshold);
  EXPECT_EQ(json["metrics"][1]["accuracy"], evaluation.metrics[1].accuracy);
}

}  // namespace
}  // namespace acmp
