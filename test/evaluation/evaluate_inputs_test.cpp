#include "evaluate_inputs.h"

#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class EvaluateInputsTest : public TestFolder {
 protected:
  void Touch(const std::string& name) const { WriteText(name, "x"); }

  PredictionIndex Find(const std::string& name = "") const { return FindPredictions(folder(), images_, name); }

  std::string FileOf(int image, const std::string& name = "") const {
    const PredictionIndex index = Find(name);
    const auto found = index.files.find(image);
    return found == index.files.end() ? "" : fs::relative(found->second, folder()).string();
  }

  std::vector<ListedImage> images_ = {{0, "P100.jpg"}, {1, "P200.jpg"}, {7, "P300.jpg"}};
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
  EXPECT_THAT(Find().notes, ElementsAre(HasSubstr("1 maps left aside")));
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
  EXPECT_THROW(FindPredictions(folder() / "missing", images_, ""), InvalidInputError);
  EXPECT_THROW(Find("("), InvalidInputError);
}

}  // namespace
}  // namespace acmp
