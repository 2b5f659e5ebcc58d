#include "acmp_mapping/evaluation/evaluate_inputs.h"

#include <cmath>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class EvaluateInputsTest : public testing::Test {
 protected:
  EvaluateInputsTest() : folder_(fs::path(testing::TempDir()) / ("acmp_evaluate_inputs_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~EvaluateInputsTest() override { fs::remove_all(folder_); }

  void Touch(const fs::path& name) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << "x";
  }

  PredictionIndex Find(const std::string& name = "") const { return FindPredictions(folder_, images_, name); }

  std::string FileOf(int image, const std::string& name = "") const {
    const PredictionIndex index = Find(name);
    const auto found = index.files.find(image);
    return found == index.files.end() ? "" : fs::relative(found->second, folder_).string();
  }

  fs::path folder_;
  std::vector<EvaluationImage> images_ = {{0, "P100.jpg"}, {1, "P200.jpg"}, {7, "P300.jpg"}};
};

TEST_F(EvaluateInputsTest, TakesFilesByIndexOrByTheImagesOwnStem) {
  Touch("depth_0007.png");
  Touch("P100.dmb");
  Touch("00000001.DMB");
  Touch("000001_normal.txt");
  EXPECT_EQ(FileOf(7), "depth_0007.png");
  EXPECT_EQ(FileOf(0), "P100.dmb");
  EXPECT_EQ(FileOf(1), "00000001.DMB");
}

TEST_F(EvaluateInputsTest, TheOwnStemGoesBeforeTheIndexAndTheFirstFileBeforeLaterOnes) {
  Touch("0.dmb");
  Touch("P100.dmb");
  Touch("a_1.dmb");
  Touch("b_1.dmb");
  EXPECT_EQ(FileOf(0), "P100.dmb");
  EXPECT_EQ(FileOf(1), "a_1.dmb");
  EXPECT_EQ(FileOf(1, "^b_"), "b_1.dmb");
}

TEST_F(EvaluateInputsTest, PrefersPfmAndSaysSo) {
  Touch("000000.pfm");
  Touch("000000.png");
  Touch("000001.png");
  EXPECT_EQ(FileOf(0), "000000.pfm");
  EXPECT_EQ(FileOf(1), "000001.png");
  EXPECT_THAT(Find().notes, ElementsAre("1 images have a .pfm and another map: took the .pfm"));
}

TEST_F(EvaluateInputsTest, NamesFilesItCannotRead) {
  Touch("000000.pfm");
  Touch("000001.npy");
  EXPECT_THAT(Find().notes, ElementsAre(HasSubstr("1 .npy files are not read")));
}

TEST_F(EvaluateInputsTest, ReadsTheOutputOfThePublicProgram) {
  Touch("2333_00000000/depths.dmb");
  Touch("2333_00000000/depths_geom.dmb");
  Touch("2333_00000007/depths.dmb");
  Touch("2333_00000001/normals.dmb");
  EXPECT_EQ(FileOf(0), "2333_00000000/depths_geom.dmb");
  EXPECT_EQ(FileOf(7), "2333_00000007/depths.dmb");
  EXPECT_EQ(FileOf(1), "");
  EXPECT_EQ(FileOf(0, "depths.dmb"), "2333_00000000/depths.dmb");
}

TEST_F(EvaluateInputsTest, RefusesFoldersWithoutAnyMapOfTheScene) {
  EXPECT_THROW(Find(), InvalidInputError);
  Touch("000003.pfm");  // not an image of the scene
  EXPECT_THROW(Find(), InvalidInputError);
  EXPECT_THROW(FindPredictions(folder_ / "missing", images_, ""), InvalidInputError);
  EXPECT_THROW(Find("("), InvalidInputError);
}

TEST_F(EvaluateInputsTest, ReadsTheImageList) {
  std::ofstream(folder_ / "cameras.txt") << "# index filename ...\n\n0 a.png 1 2 3\n 12 sub/b.png 1\n";
  const auto images = ReadImageList(folder_);
  ASSERT_EQ(images.size(), 2u);
  EXPECT_EQ(images[1].index, 12);
  EXPECT_EQ(images[1].name, "sub/b.png");
}

TEST_F(EvaluateInputsTest, RefusesABadImageListNamingTheLine) {
  EXPECT_THROW(ReadImageList(folder_), InvalidInputError);
  std::ofstream(folder_ / "cameras.txt") << "# nothing\n";
  EXPECT_THROW(ReadImageList(folder_), InvalidInputError);
  std::ofstream(folder_ / "cameras.txt") << "0 a.png\n-1 b.png\n";
  try {
    ReadImageList(folder_);
    FAIL() << "not refused";
  } catch (const InvalidInputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("cameras.txt:2: \"-1 b.png\""));
  }
}

TEST_F(EvaluateInputsTest, ReadsPngDepthInItsUnit) {
  Image<uint16_t> counts(2, 1);
  counts(0, 0) = 1234;
  WritePng16(folder_ / "depth.png", counts);
  EXPECT_EQ(ReadDepthMap(folder_ / "depth.png", 1000.0)(0, 0), 1.234f);
  EXPECT_EQ(ReadDepthMap(folder_ / "depth.png", 5000.0)(0, 0), 1234 / 5000.0f);
  EXPECT_EQ(ReadDepthMap(folder_ / "depth.png", 1000.0)(1, 0), 0.0f);
}

TEST_F(EvaluateInputsTest, FindsFoldersInTheSceneFirst) {
  fs::create_directories(folder_ / "depth");
  EXPECT_EQ(FindFolder(folder_, "depth"), folder_ / "depth");
  EXPECT_EQ(FindFolder(folder_ / "depth", folder_.string()), folder_);
  EXPECT_THROW(FindFolder(folder_, "no_such_folder"), InvalidInputError);
}

TEST(ParseSubset, ReadsIndicesAndRanges) {
  EXPECT_THAT(ParseSubset("0,3,7-9"), ElementsAre(0, 3, 7, 8, 9));
  EXPECT_THAT(ParseSubset("007"), ElementsAre(7));
  for (const char* bad : {"", ",", "a", "3-1", "1-", "-1", "1.5", "99999999999", "0-1000000"}) {
    EXPECT_THROW(ParseSubset(bad), InvalidInputError) << bad;
  }
}

}  // namespace
}  // namespace acmp
