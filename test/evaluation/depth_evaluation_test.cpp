#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

DepthMap Row(const std::vector<float>& values) {
  DepthMap map(static_cast<int>(values.size()), 1);
  std::copy(values.begin(), values.end(), map.begin());
  return map;
}

TEST(EvaluateDepth, CountsErrorsAmongAllPixelsWithGroundTruth) {
  const DepthMap truth = Row({1, 2, 3, 1, 1, 1, 1, 0, kNan});
  const DepthMetrics metrics = EvaluateDepth(Row({1.005f, 2.03f, 3.12f, 0, -1, kNan, kInf, 5, 5}), truth);
  EXPECT_EQ(metrics.ground_truth_pixels, 7u);
  const double each = 100 / 7.0;
  for (const auto& [i, absolute, relative] : {std::tuple(0, 1, 1), {1, 2, 2}, {2, 2, 3}}) {
    EXPECT_NEAR(metrics.below_absolute[i], absolute * each, 1e-9) << i;
    EXPECT_NEAR(metrics.below_relative[i], relative * each, 1e-9) << i;
  }
  EXPECT_NEAR(metrics.density, 3 * each, 1e-9);
  EXPECT_NEAR(metrics.median_error, 0.03, 1e-6);  // float rounding of depths below 8
  EXPECT_NEAR(EvaluateDepth(Row({1.005f, 2.03f}), Row({1, 2})).median_error, 0.0175, 1e-6)
      << "the mean of the middle two";
}

TEST(MedianScale, IsThatOfWhatIsKnownOnBothSides) {
  EXPECT_DOUBLE_EQ(MedianScale(Row({1, 2, 0, 4, 5}), Row({2, 4, 3, 0, 50})), 2);
  EXPECT_EQ(MedianScale(Row({0, kNan}), Row({1, 1})), 1);
  EXPECT_EQ(MedianScale(DepthMap(), Row({1, 1})), 1);
}

TEST(EvaluateDepth, IsUndefinedWithoutGroundTruth) {
  const DepthMetrics metrics = EvaluateDepth(Row({1.0f, 1.0f}), Row({0.0f, kNan}));
  EXPECT_EQ(metrics.ground_truth_pixels, 0u);
  EXPECT_TRUE(std::isnan(metrics.below_absolute[0]));
  EXPECT_TRUE(std::isnan(metrics.density));
}

TEST(EvaluateDepth, AnErrorOfExactlyTheThresholdIsNotBelowIt) {
  // 0.2f is twice 0.1f: their difference is the threshold to the last bit.
  EXPECT_EQ(EvaluateDepth(Row({0.2f}), Row({0.1f})).below_absolute[2], 0.0);
  EXPECT_EQ(EvaluateDepth(Row({std::nextafter(0.2f, 0.0f)}), Row({0.1f})).below_absolute[2], 100.0);
}

TEST(EvaluateDepth, LooksUpAnEstimateOfAnotherSizeAtTheNearestPixelCentre) {
  // Three times smaller: pixels 0..2 belong to 0, 3..5 to 1.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({1.0f, 2.0f}), Row({1, 1, 1, 2, 2, 2})).below_absolute[0], 100.0);
  // Three times larger: the middle one of each three.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({9, 1, 9, 9, 2, 9}), Row({1, 2})).below_absolute[0], 100.0);
  // Twice larger: centres lie half way, which goes to the even pixel: 0.5 -> 0, 2.5 -> 2.
  EXPECT_DOUBLE_EQ(EvaluateDepth(Row({1, 9, 2, 9}), Row({1, 2})).below_absolute[0], 100.0);
  // Another aspect ratio: each axis by itself.
  DepthMap estimate(1, 2);
  estimate(0, 0) = 1;
  estimate(0, 1) = 2;
  DepthMap truth(2, 4, 1.0f);
  for (int row = 2; row < 4; ++row) truth(0, row) = truth(1, row) = 2;
  EXPECT_DOUBLE_EQ(EvaluateDepth(estimate, truth).below_absolute[0], 100.0);
}

TEST(MeanOfDepthMetrics, WeighsImagesEquallyAndLeavesOutThoseWithoutGroundTruth) {
  const DepthMetrics good = EvaluateDepth(Row({1, 1, 1}), Row({1, 1, 1}));
  const DepthMetrics missing = EvaluateDepth(DepthMap(), Row({1}));
  const DepthMetrics no_truth = EvaluateDepth(Row({1}), Row({0}));
  const DepthMetrics mean = Mean({good, missing, no_truth});
  EXPECT_EQ(mean.ground_truth_pixels, 2u);
  EXPECT_DOUBLE_EQ(mean.below_absolute[0], 50.0);
  EXPECT_DOUBLE_EQ(mean.density, 50.0);
  EXPECT_DOUBLE_EQ(mean.median_error, 0.0);  // of the only image that has one
  EXPECT_TRUE(std::isnan(Mean({no_truth}).density));
  EXPECT_TRUE(std::isnan(Mean({}).density));
}

// A small synthetic scene on disk with predictions: noise and holes in image 0, none for image 1, half size for
// image 2.
class EvaluateDepthTest : public TestFolder {
 protected:
  EvaluateDepthTest() {
    WriteSceneFiles(folder() / "scene", views_, 0.2f);
    std::filesystem::create_directories(folder() / "maps");
    WritePfm(folder() / "maps/000000.pfm", Disturbed(views_[0].true_depth));
    WriteDmb(folder() / "maps/000002.dmb", DepthMap(32, 24, 2.5f));
  }

  static DepthMap Disturbed(const DepthMap& truth) {
    DepthMap map = truth.Clone();
    for (size_t i = 0; i < map.size(); ++i) {
      RandomStream random(5, static_cast<uint32_t>(i), 0);
      map.data()[i] += random.NextUniform(-0.1f, 0.1f);
      if (random.NextUniform() < 0.2f)
        map.data()[i] = random.NextUniform() < 0.5f ? 0.0f : std::numeric_limits<float>::quiet_NaN();
    }
    return map;
  }

  /// As in the file, in millimetres.
  DepthMap Truth(size_t i) const {
    return ReadDepth(folder() / "scene/depth" / ("00000" + std::to_string(i) + ".png"));
  }

  DepthEvaluationOptions Options() const {
    DepthEvaluationOptions options;
    options.scene = folder() / "scene";
    options.predictions = folder() / "maps";
    options.low_texture = 30.0;  // 11 pixels are a large part of so small a picture
    return options;
  }

  const std::vector<SyntheticView> views_ = MakeSyntheticScene({64, 48, 3});
};

void ExpectSame(const DepthMetrics& a, const DepthMetrics& b) {
  EXPECT_EQ(a.ground_truth_pixels, b.ground_truth_pixels);
  EXPECT_EQ(a.below_absolute, b.below_absolute);
  EXPECT_EQ(a.below_relative, b.below_relative);
  EXPECT_EQ(a.density, b.density);
}

TEST_F(EvaluateDepthTest, IsThatOfTheMaps) {
  DepthEvaluationOptions options = Options();
  options.masks = {"low_texture"};
  const DepthEvaluation evaluation = EvaluateDepthFolder(options);
  ASSERT_EQ(evaluation.images.size(), 3u);
  std::vector<DepthMap> maps(3);
  maps[0] = Disturbed(views_[0].true_depth);
  maps[2] = DepthMap(32, 24, 2.5f);
  std::vector<DepthMetrics> all, masked;
  DepthErrors pool;
  double share = 0;
  for (size_t i = 0; i < 3; ++i) {
    const Image<unsigned char>& mask = views_[i].low_texture;
    all.push_back(EvaluateDepth(maps[i], Truth(i)));
    masked.push_back(EvaluateDepth(maps[i], Truth(i), mask.View()));
    pool.Add(maps[i], Truth(i));
    share += static_cast<double>(std::count(mask.begin(), mask.end(), 1)) / 3 / static_cast<double>(mask.size());
    EXPECT_EQ(evaluation.images[i].has_prediction, i != 1);
    ExpectSame(evaluation.images[i].metrics, all[i]);
  }
  ExpectSame(evaluation.mean, Mean(all));
  ExpectSame(evaluation.pool, pool.Metrics());
  EXPECT_EQ(evaluation.regions.back().name, "low_texture");
  ExpectSame(evaluation.regions.back().mean, Mean(masked));
  EXPECT_NEAR(evaluation.regions.back().share, share, 1e-12);
}

TEST_F(EvaluateDepthTest, HonoursScaleSubsetAndMaxDepth) {
  DepthEvaluationOptions options = Options();
  options.subset = {2};
  options.scale = 0.5;
  options.low_texture = 0;
  const DepthEvaluation evaluation = EvaluateDepthFolder(options);
  ASSERT_EQ(evaluation.images.size(), 1u);
  EXPECT_TRUE(evaluation.regions.empty());
  const DepthMap truth = Truth(2);
  ExpectSame(evaluation.pool, EvaluateDepth(DepthMap(32, 24, 1.25f), truth));

  options.truth.max_depth = 2.0;
  const auto near = std::count_if(truth.begin(), truth.end(), [](float z) { return z <= 2.0f; });
  EXPECT_EQ(EvaluateDepthFolder(options).pool.ground_truth_pixels, static_cast<size_t>(near));
}

TEST_F(EvaluateDepthTest, RefusesBadOptionsAndInput) {
  const auto expect_refused = [this](const auto& change, const std::string& message) {
    DepthEvaluationOptions options = Options();
    change(&options);
    EXPECT_REFUSED(EvaluateDepthFolder(options), message);
  };
  expect_refused([](DepthEvaluationOptions* o) { o->scale = 0; }, "--scale = 0");
  expect_refused([](DepthEvaluationOptions* o) { o->truth.png_unit = std::nan(""); }, "--gt-png-unit = nan");
  expect_refused([](DepthEvaluationOptions* o) { o->truth.folder = "truth"; }, "truth");
  expect_refused([](DepthEvaluationOptions* o) { o->subset = {99}; }, "no ground truth");
  std::filesystem::create_directories(folder() / "small_masks");
  WritePng(folder() / "small_masks/000000.png", ColorImage(4, 4));
  const std::string small = (folder() / "small_masks").string();
  expect_refused([&](DepthEvaluationOptions* o) { o->masks = {small}; }, "size 4 x 4");
  DepthEvaluationOptions options = Options();
  options.masks = {"sparse"};
  EXPECT_EQ(EvaluateDepthFolder(options).regions.size(), 1u);  // no mask of that name: lowtex alone
}

TEST_F(EvaluateDepthTest, ReportsTheSameFiguresInEveryForm) {
  const DepthEvaluation evaluation = EvaluateDepthFolder(Options());
  const std::string table = DepthTable(evaluation, false);
  char figure[32];
  std::snprintf(figure, sizeof(figure), "%7.2f", evaluation.mean.below_absolute[1]);
  EXPECT_THAT(table, HasSubstr("mean of 3 images"));
  EXPECT_THAT(table, HasSubstr(figure));
  EXPECT_THAT(table, HasSubstr("1 000001.png MISSING"));
  EXPECT_THAT(table, HasSubstr("no prediction file for 1 of 3 images: [1]"));
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 8);
  EXPECT_THAT(DepthTable(evaluation, true), Not(HasSubstr("MISSING")));

  const auto json = nlohmann::json::parse(DepthJson(evaluation));
  EXPECT_FALSE(json["images"][1]["predicted"]);
  EXPECT_EQ(json["images"][1]["figures"], nlohmann::json({0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, nullptr}));
  EXPECT_EQ(json["columns"].back(), "med");
  EXPECT_EQ(json["pool"].back(), evaluation.pool.median_error);
}

TEST(LowTextureMask, IsWhereTheDeviationIsBelowTheLimit) {
  constexpr int kEdge = 18, kReach = 5;  // windows of 11 px
  for (const int amplitude : {3, 5}) {
    GrayImage image(37, 29, 100);  // flat, and from the edge on a checkerboard: that is its deviation
    for (int row = 0; row < 29; ++row) {
      for (int col = kEdge; col < 37; ++col)
        image(col, row) += static_cast<float>((row + col) % 2 == 0 ? amplitude : -amplitude);
    }
    const Image<unsigned char> mask = LowTextureMask(image.Clone(), 37, 29, 4.0);
    for (int row = 0; row < 29; ++row) {
      for (int col = 0; col < 37; ++col) {
        if (col < kEdge - kReach) {
          EXPECT_NE(mask(col, row), 0) << col << " " << row;
        } else if (col >= kEdge + kReach) {
          EXPECT_EQ(mask(col, row) != 0, amplitude < 4) << col << " " << row;
        }
      }
    }
  }
}

TEST_F(EvaluateDepthTest, AMapIsFoundByNameOrIndex) {
  namespace fs = std::filesystem;
  DepthEvaluationOptions options = Options();
  options.low_texture = 0;
  const auto density_with = [&](const std::vector<std::pair<std::string, float>>& files) {
    fs::remove_all(options.predictions);
    fs::create_directories(options.predictions);
    for (const auto& [name, depth] : files) {
      const fs::path path = options.predictions / name;
      const DepthMap map(64, 48, depth);
      if (path.extension() == ".pfm") WritePfm(path, map);
      if (path.extension() == ".dmb") WriteDmb(path, map);
      if (path.extension() == ".png") WriteDepthPng(path, map);
    }
    return EvaluateDepthFolder(options).mean.density;
  };
  fs::rename(options.scene / "images/000002.png", options.scene / "images/last.png");
  std::string cameras = ReadText(options.scene / "cameras.txt");
  cameras.replace(cameras.find("000002.png"), 10, "last.png");
  WriteText("scene/cameras.txt", cameras);
  const double each = 100 / 3.0;
  EXPECT_NEAR(density_with({{"00000000.dmb", 1}, {"000001.png", 1}, {"last.pfm", 1}}), 3 * each, 1e-9);
  EXPECT_NEAR(density_with({{"000002.pfm", 1}}), each, 1e-9) << "by its index";
  EXPECT_NEAR(density_with({{"000002.pfm", 0}, {"last.dmb", 1}, {"000001.dmb", 1}}), each, 1e-9)
      << ".pfm goes before .dmb";
  EXPECT_NEAR(density_with({{"000002.dmb", 0}, {"last.dmb", 1}}), each, 1e-9) << "the name goes before the index";
  EXPECT_THROW(density_with({}), InvalidInputError);
  EXPECT_THROW(density_with({{"000003.pfm", 1}}), InvalidInputError) << "of no image of the scene";
  fs::remove_all(options.predictions);
  EXPECT_THROW(EvaluateDepthFolder(options), InvalidInputError);
}

}  // namespace
}  // namespace acmp
