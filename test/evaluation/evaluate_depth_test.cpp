#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using testing::HasSubstr;

// A small synthetic scene on disk with predictions: noise and holes in image 0, none for image 1, half size for
// image 2.
class EvaluateDepthTest : public TestFolder {
 protected:
  EvaluateDepthTest() {
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

namespace fs = std::filesystem;

class EvaluateInputsTest : public TestFolder {
 protected:
  PredictionIndex Find(const std::string& name = "") const {
    return FindPredictions(folder(), {{0, "P100.jpg"}, {1, "P200.jpg"}, {7, "P300.jpg"}}, name);
  }
};

TEST_F(EvaluateInputsTest, WhichFileIsWhoseMap) {
  struct Case {
    std::vector<std::string> files;
    std::string name, found;  ///< "0: FILE, 7: FILE": of the images that have one
  };
  const std::vector<std::string> of_program = {"2333_00000000/depths.dmb", "2333_00000000/depths_geom.dmb",
                                               "2333_00000007/depths.dmb", "2333_00000001/normals.dmb"};
  for (const Case& c : std::vector<Case>{
           // By index or by the image's own stem, which goes before it, and the first file before later ones.
           {{"depth_0007.png", "P100.dmb", "00000001.DMB", "000001_normal.txt"},
            "",
            "0: P100.dmb, 1: 00000001.DMB, 7: depth_0007.png"},
           {{"0.dmb", "P100.dmb", "a_1.dmb", "b_1.dmb"}, "", "0: P100.dmb, 1: a_1.dmb"},
           {{"0.dmb", "P100.dmb", "a_1.dmb", "b_1.dmb"}, "^b_", "1: b_1.dmb"},
           // The output of the public program.
           {of_program, "", "0: 2333_00000000/depths_geom.dmb, 7: 2333_00000007/depths.dmb"},
           {of_program, "depths.dmb", "0: 2333_00000000/depths.dmb, 7: 2333_00000007/depths.dmb"},
           {{"000000.pfm", "000000.png", "000001.png", "000007.png", "000007.dmb"},
            "",
            "0: 000000.pfm, 1: 000001.png, 7: 000007.dmb"}}) {
    for (const auto& entry : fs::directory_iterator(folder())) fs::remove_all(entry);
    for (const std::string& file : c.files) WriteText(file, "x");
    std::string found;
    for (const auto& [image, path] : Find(c.name).files) {
      found += Concat(found.empty() ? "" : ", ", image, ": ", fs::relative(path, folder()).string());
    }
    EXPECT_EQ(found, c.found);
  }
  EXPECT_THAT(Find().notes, testing::ElementsAre(HasSubstr("2 maps left aside")));
}

TEST_F(EvaluateInputsTest, RefusesFoldersWithoutAnyMapOfTheScene) {
  EXPECT_THROW(Find(), InvalidInputError);
  WriteText("000003.pfm", "x");  // not an image of the scene
  EXPECT_THROW(Find(), InvalidInputError);
  EXPECT_THROW(FindPredictions(folder() / "missing", {}, ""), InvalidInputError);
  EXPECT_THROW(Find("("), InvalidInputError);
}

}  // namespace
}  // namespace acmp
