#include <gmock/gmock.h>

#include "acmp_mapping/dataset/map_io.h"
#include "reconstruction/run_fixture.h"

// --prior-depth: which images have it, what is said of maps that are of no use, and that runs know when they change.

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class ScenePriorDepthTest : public ReconstructRunFixture {
 protected:
  ScenePriorDepthTest() { options_.prior_depth = folder() / "depths"; }

  void WriteDepth(int image, float depth) const {
    std::filesystem::create_directories(folder() / "depths");
    WritePfm(folder() / "depths" / ("0000000" + std::to_string(image) + ".pfm"), DepthMap(5, 4, depth));
  }
};

TEST_F(ScenePriorDepthTest, ItIsSaidHowManyImagesHaveItAndWhyItIsNotUsed) {
  WriteDepth(1, 2);
  WriteDepth(2, 2);
  WriteDepth(3, 0);
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("2 of 4 images have prior depth in " + options_.prior_depth.string()));
  EXPECT_THAT(log_.str(), AllOf(HasSubstr("00000003.png: its prior depth"), HasSubstr("has no pixel with a positive")));
  EXPECT_THAT(log_.str(), HasSubstr("the prior depth of 3 images is not used, for example of 00000001.png: "))
      << "one and the same depth says nothing";
}

TEST_F(ScenePriorDepthTest, BadOnesAreRefusedBeforeAnythingIsDone) {
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("does not exist"));
  WriteDepth(7, 2);
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("none for any of the 4 images"));
  WriteDepth(0, 2);
  std::filesystem::resize_file(folder() / "depths" / "00000000.pfm", 30);
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("00000000.pfm"));
  options_.preset = "acmp";
  EXPECT_THAT(ErrorOf(&fake_), AllOf(HasSubstr("--prior-depth"), HasSubstr("completion")));
  EXPECT_TRUE(fake_.calls.empty());
}

TEST_F(ScenePriorDepthTest, AFinishedRunKnowsThatItHasChanged) {
  WriteDepth(1, 2);
  Run(&fake_);
  Run(&fake_);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
  WriteDepth(1, 3);
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("prior depth"));
  options_.prior_depth.clear();
  EXPECT_THAT(ErrorOf(&fake_), Not(HasSubstr("already complete")));
}

}  // namespace
}  // namespace acmp
