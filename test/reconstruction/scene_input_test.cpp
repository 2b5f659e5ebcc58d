// --masks and --prior-depth: which images have them, what is said of bad ones, and that runs know when they change.
#include <gmock/gmock.h>

#include "acmp_mapping/dataset/map_io.h"
#include "reconstruction/run_fixture.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class SceneInputTest : public ReconstructRunFixture {
 protected:
  /// @param used_cols so many columns from the left count
  void WriteMask(int image, int used_cols, int width = kWidth) {
    options_.masks = folder() / "masks";
    std::filesystem::create_directories(options_.masks);
    ColorImage picture(width, kHeight);
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < used_cols; ++col) picture(col, row) = {1, 0, 0};
    }
    WritePng(options_.masks / ("0000000" + std::to_string(image) + ".png.png"), picture);
  }
  void WriteDepth(int image, float depth) {
    options_.prior_depth = folder() / "depths";
    std::filesystem::create_directories(options_.prior_depth);
    WritePfm(options_.prior_depth / ("0000000" + std::to_string(image) + ".pfm"), DepthMap(5, 4, depth));
  }
};

TEST_F(SceneInputTest, ItIsSaidHowManyImagesHaveAMask) {
  WriteMask(1, 12);
  WriteMask(2, 15);
  options_.images = "0,2,3";
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("1 of 3 images have a mask in " + options_.masks.string()));
}

TEST_F(SceneInputTest, AnImageOfWhichNothingCountsTakesNoPart) {
  WriteMask(1, 0);
  Run(&fake_);
  EXPECT_THAT(log_.str(), AllOf(HasSubstr("image 00000001.png takes no part"), HasSubstr("ignores every pixel")));
  EXPECT_FALSE(Has("depth/000001.pfm"));
  EXPECT_TRUE(Has("depth/000000.pfm") && Has("depth/000002.pfm") && Has("depth/000003.pfm"));
  for (int image : {0, 2, 3}) WriteMask(image, 0);
  options_.output = output("nothing");
  EXPECT_THAT(Error(), AllOf(HasSubstr("--masks"), HasSubstr("all masks ignore every pixel")));
}

TEST_F(SceneInputTest, ItIsSaidHowManyImagesHavePriorDepthAndWhyItIsNotUsed) {
  WriteDepth(1, 2);
  WriteDepth(2, 2);
  WriteDepth(3, 0);
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("2 of 4 images have prior depth in " + options_.prior_depth.string()));
  EXPECT_THAT(log_.str(), AllOf(HasSubstr("00000003.png: its prior depth"), HasSubstr("has no pixel")));
  EXPECT_THAT(log_.str(), HasSubstr("the prior depth of 3 images is not used, for example of 00000001.png: "))
      << "one and the same depth says nothing";
}

TEST_F(SceneInputTest, BadOnesAreRefusedBeforeAnythingIsDone) {
  WriteMask(7, 12);
  EXPECT_THAT(Error(), HasSubstr("none for any of the 4 images"));
  WriteMask(2, 12, kWidth + 2);
  EXPECT_THAT(Error(), AllOf(HasSubstr("00000002.png.png"), HasSubstr("22 x 15")));
  options_.masks.clear();
  WriteDepth(0, 2);
  std::filesystem::resize_file(options_.prior_depth / "00000000.pfm", 30);
  EXPECT_THAT(Error(), HasSubstr("00000000.pfm"));
  options_.preset = "acmp";
  EXPECT_THAT(Error(), AllOf(HasSubstr("--prior-depth"), HasSubstr("completion")));
  EXPECT_TRUE(fake_.calls.empty());
  EXPECT_FALSE(Has("depth"));
}

TEST_F(SceneInputTest, AFinishedRunKnowsThatTheyHaveChanged) {
  WriteMask(1, 12);
  WriteDepth(1, 2);
  Run(&fake_);
  Run(&fake_);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
  WriteMask(1, 13);
  EXPECT_THAT(Error(), HasSubstr("masks"));
  WriteMask(1, 12);
  WriteDepth(1, 3);
  EXPECT_THAT(Error(), HasSubstr("prior depth"));
  options_.prior_depth.clear();
  EXPECT_THAT(Error(), Not(HasSubstr("already complete")));
}

}  // namespace
}  // namespace acmp
