#include "acmp_mapping/evaluation/evaluate.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/camera_list.h"
#include "acmp_mapping/dataset/map_io.h"
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
    SyntheticSceneOptions options;
    options.width = kWidth;
    options.height = kHeight;
    options.keyframes = 3;
    views_ = MakeSyntheticScene(options);
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

  std::vector<SyntheticView> views_;
  std::vector<DepthMap> truth_;
  PointCloud cloud_;
};

using Points = std::vector<Eigen::Vector3f>;  // as in a cloud: walls lie on borders of voxels
using Cell = std::tuple<double, double, double>;

Cell CellOf(const Eigen::Vector3f& p, double size, double shift) {
  return {std::floor(p.x() / size + shift), std::floor(p.y() / size + shift), std::floor(p.z() / size + shift)};
}

double ShareWithin(const Points& points, const Points& targets, double threshold) {
  double sum = 0;
  size_t cells = 0;
  for (const double shift : {0.0, 0.5}) {
    std::map<Cell, std::pair<double, double>> grid;
    for (const Eigen::Vector3f& p : points) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const Eigen::Vector3f& t : targets) {
        nearest = std::min(nearest, (p.cast<double>() - t.cast<double>()).norm());
      }
      auto& [within, count] = grid[CellOf(p, kVoxel, shift)];
      within += nearest <= threshold ? 1 : 0;
      ++count;
    }
    for (const auto& [cell, counts] : grid) sum += counts.first / counts.second;
    cells += grid.size();
  }
  return 100.0 * sum / static_cast<double>(cells);
}

TEST_F(EvaluateCloudTest, AgreesWithBruteForce) {
  const CloudEvaluation evaluation = EvaluateCloudFile(Options());
  Points all, judged, surface;
  for (const SurfacePoint& point : cloud_) {
    all.emplace_back(point.position.x, point.position.y, point.position.z);
    bool observed = false;
    for (size_t i = 0; i < views_.size(); ++i) {
      const Eigen::Vector3d in_cam = views_[i].frame.cam_from_world * all.back().cast<double>();
      const Eigen::Vector2d pixel = views_[i].frame.camera.Project(in_cam);
      const double col = std::round(pixel.x()), row = std::round(pixel.y());
      if (in_cam.z() <= 0 || col < 0 || row < 0 || col >= kWidth || row >= kHeight) continue;
      const float z = truth_[i](static_cast<int>(col), static_cast<int>(row));
      observed = observed || (z > 0 && in_cam.z() <= z + 0.2);
    }
    if (observed) judged.push_back(all.back());
  }
  const std::vector<ListedCamera> cameras = ReadCameraList(folder() / "scene/cameras.txt");
  std::map<Cell, Eigen::Vector3f> first;
  for (size_t i = 0; i < views_.size(); ++i) {
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        if (truth_[i](col, row) == 0) continue;
        const Eigen::Vector3d in_cam = cameras[i].camera.Unproject({col, row}, truth_[i](col, row));
        const Eigen::Vector3f p = (cameras[i].world_from_cam * in_cam).cast<float>();
        if (first.emplace(CellOf(p, kVoxel / 2, 0), p).second) surface.push_back(p);
      }
    }
  }
  EXPECT_EQ(evaluation.reconstructed_points, all.size());
  EXPECT_EQ(evaluation.observed_points, judged.size());
  EXPECT_LT(judged.size(), all.size() - 100);  // behind surfaces and in the holes
  EXPECT_GT(judged.size(), 100u);
  EXPECT_EQ(evaluation.true_points, surface.size());
  EXPECT_EQ(evaluation.true_maps, 3u);
  for (const CloudMetrics& m : evaluation.metrics) {
    const double accuracy = ShareWithin(judged, surface, m.threshold);
    const double completeness = ShareWithin(surface, all, m.threshold);
    EXPECT_NEAR(m.accuracy, accuracy, 1e-6);
    EXPECT_NEAR(m.completeness, completeness, 1e-6);
    EXPECT_GT(accuracy, 5);
    EXPECT_LT(accuracy, 95);
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

TEST_F(EvaluateCloudTest, RefusesBadOptionsAndInput) {
  const auto expect_refused = [](const CloudEvaluationOptions& options, const std::string& message) {
    EXPECT_THAT(MessageOf<InvalidInputError>([&] { EvaluateCloudFile(options); }), HasSubstr(message));
  };
  CloudEvaluationOptions options = Options();
  options.thresholds = {0.1, -1};
  expect_refused(options, "--thresholds = -1");
  options.thresholds = {};
  expect_refused(options, "0 values: must be at least 1");
  options = Options();
  options.voxel_size = 0;
  expect_refused(options, "--voxel = 0");
  options = Options();
  options.truth.max_depth = -1;
  expect_refused(options, "--max-depth = -1");
  options.truth.max_depth = 1e-6;
  expect_refused(options, "3 maps, 0 pixels of known depth");
  options = Options();
  options.truth.folder = "missing";
  expect_refused(options, "missing");
  options = Options();
  options.ground_truth = folder() / "truth";
  expect_refused(options, "cameras.txt");
}

}  // namespace
}  // namespace acmp
