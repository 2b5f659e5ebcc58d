#include "acmp_mapping/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using testing::HasSubstr;

// A small synthetic scene on disk with predictions: noise and holes in image 0, none for image 1, half size for
// image 2.
class EvaluateDepthTest : public TestFolder {
 protected:
  EvaluateDepthTest() {
    SyntheticSceneOptions options;
    options.width = 64;
    options.height = 48;
    options.keyframes = 3;
    views_ = MakeSyntheticScene(options);
    WriteSceneFiles(folder() / "scene", views_, 0.2f);
    std::filesystem::create_directories(folder() / "maps");
    WritePfm(folder() / "maps/000000.pfm", Disturbed(views_[0].true_depth));
    WriteDmb(folder() / "maps/2.dmb", DepthMap(32, 24, 2.5f));
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

  DepthEvaluationOptions Options() const {
    DepthEvaluationOptions options;
    options.scene = folder() / "scene";
    options.predictions = folder() / "maps";
    options.low_texture = 30.0;  // 11 pixels are a large part of so small a picture
    return options;
  }

  std::vector<SyntheticView> views_;
};

// Share in percent of pixels with an absolute error below `limit`, straight from the definition; `estimate` at the
// truth's size; the truth rounded to millimetres as in the file.
double ShareBelow(const DepthMap& estimate, const DepthMap& truth, double limit, const Image<unsigned char>* mask) {
  size_t count = 0, below = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (mask && !mask->data()[i]) continue;
    const double true_depth = std::round(1000.0 * truth.data()[i]) / 1000.0;
    const double depth = estimate.empty() ? 0.0 : estimate.data()[i];
    ++count;
    below += depth > 0 && std::abs(depth - true_depth) < limit;
  }
  return 100.0 * below / count;
}

TEST_F(EvaluateDepthTest, AgreesWithAPlainReference) {
  DepthEvaluationOptions options = Options();
  options.masks = {"low_texture"};
  const DepthEvaluation evaluation = EvaluateDepthFolder(options);
  ASSERT_EQ(evaluation.images.size(), 3u);
  EXPECT_TRUE(evaluation.images[0].has_prediction);
  EXPECT_FALSE(evaluation.images[1].has_prediction);
  const DepthMap first = Disturbed(views_[0].true_depth);
  const DepthMap constant(64, 48, 2.5f);
  for (int k = 0; k < 3; ++k) {
    const double limit = kAbsoluteThresholds[k];
    const auto share = [&](int i, const DepthMap& map, bool masked) {
      return ShareBelow(map, views_[i].true_depth, limit, masked ? &views_[i].low_texture : nullptr);
    };
    // Errors are continuous, but 3072 pixels have one or two within float rounding of a threshold at most.
    constexpr double kTolerance = 0.07;
    EXPECT_NEAR(evaluation.images[0].metrics.below_absolute[k], share(0, first, false), kTolerance);
    EXPECT_EQ(evaluation.images[1].metrics.below_absolute[k], 0.0);
    EXPECT_NEAR(evaluation.images[2].metrics.below_absolute[k], share(2, constant, false), kTolerance);
    const double mean = (share(0, first, false) + share(2, constant, false)) / 3;
    EXPECT_NEAR(evaluation.mean.below_absolute[k], mean, kTolerance);
    EXPECT_NEAR(evaluation.pool.below_absolute[k], mean, kTolerance);  // images of one size, truth everywhere
    const double masked = (share(0, first, true) + share(2, constant, true)) / 3;
    EXPECT_NEAR(evaluation.regions.back().mean.below_absolute[k], masked, 2 * kTolerance);  // half of the pixels
  }
  EXPECT_EQ(evaluation.regions.back().name, "low_texture");
  double share = 0;
  for (const SyntheticView& view : views_) {
    share += std::count(view.low_texture.begin(), view.low_texture.end(), 1) / 3.0 / view.low_texture.size();
  }
  EXPECT_NEAR(evaluation.regions.back().share, share, 1e-12);
  EXPECT_NEAR(evaluation.mean.density, (100.0 + evaluation.images[0].metrics.density) / 3, 1e-9);
}

TEST_F(EvaluateDepthTest, HonoursScaleSubsetAndMaxDepth) {
  DepthEvaluationOptions options = Options();
  options.subset = {2};
  options.scale = 0.5;
  options.low_texture = 0;
  const DepthEvaluation evaluation = EvaluateDepthFolder(options);
  ASSERT_EQ(evaluation.images.size(), 1u);
  EXPECT_TRUE(evaluation.regions.empty());
  const DepthMap& truth = views_[2].true_depth;
  EXPECT_NEAR(evaluation.pool.below_absolute[2], ShareBelow(DepthMap(64, 48, 1.25f), truth, 0.1, nullptr), 0.07);

  options.truth.max_depth = 2.0;
  const auto near = std::count_if(truth.begin(), truth.end(), [](float z) { return std::round(1000 * z) <= 2000; });
  EXPECT_EQ(EvaluateDepthFolder(options).pool.ground_truth_pixels, static_cast<size_t>(near));
}

TEST_F(EvaluateDepthTest, RefusesBadOptionsAndInput) {
  const auto expect_refused = [](const DepthEvaluationOptions& options, const std::string& message) {
    EXPECT_THAT(MessageOf<InvalidInputError>([&] { EvaluateDepthFolder(options); }), HasSubstr(message));
  };
  DepthEvaluationOptions options = Options();
  options.scale = 0;
  expect_refused(options, "--scale = 0");
  options = Options();
  options.truth.png_unit = std::nan("");
  expect_refused(options, "--gt-png-unit = nan");
  options = Options();
  options.truth.folder = "truth";
  expect_refused(options, "truth");
  options = Options();
  options.subset = {99};
  expect_refused(options, "no ground truth");
  options = Options();
  options.masks = {"sparse"};
  EXPECT_EQ(EvaluateDepthFolder(options).regions.size(), 1u);  // no mask of that name: lowtex alone
  std::filesystem::create_directories(folder() / "small_masks");
  WritePng(folder() / "small_masks/000000.png", ColorImage(4, 4));
  options.masks = {(folder() / "small_masks").string()};
  expect_refused(options, "size 4 x 4");
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
  EXPECT_THAT(DepthTable(evaluation, true), testing::Not(HasSubstr("MISSING")));

  const auto json = nlohmann::json::parse(DepthJson(evaluation));
  EXPECT_FALSE(json["images"][1]["predicted"]);
  EXPECT_EQ(json["images"][1]["figures"], nlohmann::json({0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, nullptr}));
  EXPECT_EQ(json["columns"].back(), "med");
  EXPECT_EQ(json["pool"].back(), evaluation.pool.median_error);
}

// Standard deviation over 11x11 pixels, mirrored at the border without repeating it, in double.
double StandardDeviation(const Image<unsigned char>& image, int col, int row) {
  const auto mirror = [](int i, int size) { return i < 0 ? -i : i >= size ? 2 * size - 2 - i : i; };
  double sum = 0, sum_squares = 0;
  for (int v = row - 5; v <= row + 5; ++v) {
    for (int u = col - 5; u <= col + 5; ++u) {
      const double value = image(mirror(u, image.width()), mirror(v, image.height()));
      sum += value;
      sum_squares += value * value;
    }
  }
  return std::sqrt(std::max(sum_squares / 121 - sum / 121 * sum / 121, 0.0));
}

TEST(LowTextureMask, AgreesWithAPlainReference) {
  Image<unsigned char> image(37, 29);
  for (int row = 0; row < 29; ++row) {
    for (int col = 0; col < 37; ++col) {
      RandomStream random(1, static_cast<uint32_t>(row * 37 + col), 0);
      image(col, row) = static_cast<unsigned char>(100 + random.NextUniform() * col);  // from flat to rough
    }
  }
  const Image<unsigned char> mask = LowTextureMask(image.Clone(), 37, 29, 4.0);
  int low = 0;
  for (int row = 0; row < 29; ++row) {
    for (int col = 0; col < 37; ++col) {
      low += mask(col, row);
      const double deviation = StandardDeviation(image, col, row);
      // Float sums of 121 squares of about 10^4: the variance is off by up to 0.02, the deviation by 0.003.
      if (std::abs(deviation - 4.0) <= 0.003) continue;
      EXPECT_EQ(mask(col, row) != 0, deviation < 4.0) << col << " " << row;
    }
  }
  EXPECT_GT(low, 200);
  EXPECT_LT(low, 37 * 29 - 200);
}

}  // namespace
}  // namespace acmp
