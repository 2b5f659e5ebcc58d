#include <gmock/gmock.h>

#include "reconstruction/run_fixture.h"

// --masks: which images have one, what is said of bad ones, and that runs know when they change.

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class SceneMasksTest : public ReconstructRunFixture {
 protected:
  SceneMasksTest() { options_.masks = folder() / "masks"; }

  /// @param used_cols so many columns from the left count
  void WriteMask(int image, int used_cols, int width = kWidth) const {
    std::filesystem::create_directories(folder() / "masks");
    ColorImage picture(width, kHeight);
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < used_cols; ++col) picture(col, row) = {1, 0, 0};
    }
    WritePng(folder() / "masks" / ("0000000" + std::to_string(image) + ".png.png"), picture);
  }
};

TEST_F(SceneMasksTest, ItIsSaidHowManyImagesHaveOne) {
  WriteMask(1, 12);
  WriteMask(2, 15);
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("2 of 4 images have a mask in " + options_.masks.string()));
  options_.output = output("some");
  options_.images = "0,2,3";
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("1 of 3 images have a mask"));
}

TEST_F(SceneMasksTest, AnImageOfWhichNothingCountsTakesNoPart) {
  WriteMask(1, 0);
  Run(&fake_);
  EXPECT_THAT(log_.str(), AllOf(HasSubstr("image 00000001.png takes no part"), HasSubstr("ignores every pixel")));
  EXPECT_FALSE(Has("depth/000001.pfm"));
  EXPECT_TRUE(Has("depth/000000.pfm") && Has("depth/000002.pfm") && Has("depth/000003.pfm"));
  for (int image : {0, 2, 3}) WriteMask(image, 0);
  options_.output = output("nothing");
  EXPECT_THAT(ErrorOf(&fake_), AllOf(HasSubstr("--masks"), HasSubstr("all masks ignore every pixel")));
}

TEST_F(SceneMasksTest, BadMasksAreRefusedBeforeAnythingIsDone) {
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("does not exist"));
  WriteMask(7, 12);
  EXPECT_THAT(ErrorOf(&fake_), AllOf(HasSubstr("none for any of the 4 images"), HasSubstr("00000000.png.png")));
  WriteMask(2, 12, kWidth + 2);
  EXPECT_THAT(ErrorOf(&fake_), AllOf(HasSubstr("00000002.png.png"), HasSubstr("22 x 15")));
  EXPECT_TRUE(fake_.calls.empty());
  EXPECT_FALSE(Has("depth"));
}

TEST_F(SceneMasksTest, AFinishedRunKnowsThatAMaskHasChanged) {
  WriteMask(1, 12);
  Run(&fake_);
  Run(&fake_);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
  WriteMask(1, 13);
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("masks"));
  options_.masks.clear();
  EXPECT_THAT(ErrorOf(&fake_), Not(HasSubstr("already complete")));
}

}  // namespace
}  // namespace acmp
