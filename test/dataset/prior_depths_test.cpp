#include "acmp_mapping/dataset/companions.h"

#include <gmock/gmock.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "dataset/scene_fixture.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class PriorDepthsTest : public SceneFixture {
 protected:
  std::filesystem::path Path(const std::string& name) const {
    std::filesystem::create_directories((folder() / "depths" / name).parent_path());
    return folder() / "depths" / name;
  }
  static DepthMap Depth(float left, float right) {
    DepthMap depth(2, 1);
    depth(0, 0) = left;
    depth(1, 0) = right;
    return depth;
  }
};

TEST_F(PriorDepthsTest, AreFoundByTheImagesNameInAllFormats) {
  WriteImage("images/left/a.png", kWidth, kHeight);
  images = Replaced(images, "000001.png", "left/a.png");
  Scene scene = ReadColmap();
  WritePfm(Path("000000.pfm"), Depth(2, -1));
  WriteDepthPng(Path("left/a.png.png"), Depth(3, 4));
  EXPECT_EQ(AddPriorDepths(folder() / "depths", &scene), 2u);
  const Frame first = LoadFrame(scene, 0), second = LoadFrame(scene, 1, {kWidth / 2});
  ASSERT_EQ(first.prior_depth.width(), kWidth);
  ASSERT_EQ(first.prior_depth.height(), kHeight);
  EXPECT_EQ(first.prior_depth(0, 5), 2);
  EXPECT_EQ(first.prior_depth(kWidth - 1, 5), 0) << "negative: unknown";
  ASSERT_EQ(second.prior_depth.width(), kWidth / 2);
  EXPECT_EQ(second.prior_depth(0, 0), 3);
  EXPECT_EQ(second.prior_depth(kWidth / 2 - 1, 0), 4);
}

TEST_F(PriorDepthsTest, AreUndistortedWithTheirImages) {
  cameras = Replaced(cameras, "PINHOLE 32 24 30 31 16.25 12.75", "SIMPLE_RADIAL 32 24 30 16 12 0.8");
  Scene scene = ReadColmap();
  WritePfm(Path("000000.pfm"), Depth(2, 3));
  AddPriorDepths(folder() / "depths", &scene);
  const Frame frame = LoadFrame(scene, 0);
  EXPECT_EQ(frame.prior_depth(0, 0), 0) << "the lens did not see it";
  EXPECT_EQ(frame.prior_depth(14, 12), 2);
  EXPECT_EQ(frame.prior_depth(18, 12), 3);
}

TEST_F(PriorDepthsTest, WhatIsNoneIsRefused) {
  Scene scene = ReadColmap();
  const auto add = [&] { AddPriorDepths(folder() / "depths", &scene); };
  EXPECT_THAT(MessageOf<InvalidInputError>(add), HasSubstr("does not exist"));
  WritePfm(Path("frame.pfm"), Depth(2, 2));
  EXPECT_THAT(MessageOf<InvalidInputError>(add),
              AllOf(HasSubstr("none for any of the 2 images"), HasSubstr("such as 000000.pfm"),
                    HasSubstr("there is frame.pfm")));
  WritePfm(Path("000000.pfm"), Depth(2, 2));
  WriteDmb(Path("000000.dmb"), Depth(2, 2));
  EXPECT_THAT(MessageOf<InvalidInputError>(add), AllOf(HasSubstr("two files of prior depth"), HasSubstr("000000.dmb")));
  std::filesystem::remove(Path("000000.dmb"));
  WriteText("depths/000000.pfm", "Pf\n2 1\n-1.0\nabcd");
  scene = ReadColmap();
  add();
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 0); }), HasSubstr("000000.pfm"));
}

}  // namespace
}  // namespace acmp
