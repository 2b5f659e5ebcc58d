#include "acmp_mapping/dataset/companions.h"

#include <gmock/gmock.h>

#include "acmp_mapping/common/error.h"
#include "dataset/scene_fixture.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class MasksTest : public SceneFixture {
 protected:
  /// One black pixel; the others are nearly black.
  void WriteMask(const std::string& name, int col, int row, int width = kWidth, int height = kHeight) const {
    std::filesystem::create_directories((folder() / name).parent_path());
    ColorImage picture(width, height, {0, 0, 1});
    picture(col, row) = {0, 0, 0};
    WritePng(folder() / name, picture);
  }

  static int CountIgnored(const Mask& mask) {
    return static_cast<int>(std::count(mask.begin(), mask.end(), static_cast<unsigned char>(0)));
  }
};

TEST_F(MasksTest, AreFoundByTheImagesNameAndIgnoreWhatIsBlack) {
  Scene scene = ReadColmap();
  WriteMask("masks/000001.png.png", 5, 3);
  EXPECT_EQ(AddMasks(folder() / "masks", &scene), 1u);
  EXPECT_TRUE(LoadFrame(scene, 0).mask.empty()) << "it has no mask";
  const Frame frame = LoadFrame(scene, 1);
  ASSERT_EQ(frame.mask.width(), kWidth);
  EXPECT_EQ(frame.mask(5, 3), 0);
  EXPECT_EQ(CountIgnored(frame.mask), 1);
  const Frame halved = LoadFrame(scene, 1, {kWidth / 2});
  EXPECT_EQ(halved.mask(2, 1), 0);
  EXPECT_EQ(CountIgnored(halved.mask), 1);
}

TEST_F(MasksTest, AFolderWithoutMasksIsRefusedWithTheNameThatAMaskWouldHave) {
  Scene scene = ReadColmap();
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { AddMasks(folder() / "nowhere", &scene); }),
              AllOf(HasSubstr("nowhere"), HasSubstr("does not exist")));
  WriteMask("masks/000001.mask.png", 5, 3);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { AddMasks(folder() / "masks", &scene); }),
              AllOf(HasSubstr("none for any of the 2 images"), HasSubstr("such as 000000.png.png"),
                    HasSubstr("there is 000001.mask.png")));
}

TEST_F(MasksTest, AMaskOfAnotherSizeOrKindIsRefused) {
  Scene scene = ReadColmap();
  WriteMask("masks/000000.png.png", 5, 3, kWidth + 1, kHeight);
  WriteText("masks/000001.png.png", "P5 32 24 255");
  AddMasks(folder() / "masks", &scene);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 0); }),
              AllOf(HasSubstr("000000.png.png"), HasSubstr("33 x 24"), HasSubstr("32 x 24")));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 1); }),
              AllOf(HasSubstr("000001.png.png"), HasSubstr("neither a PNG nor a JPEG")));
}

TEST_F(MasksTest, WhatTheLensDidNotSeeIsIgnored) {
  cameras = Replaced(cameras, "PINHOLE 32 24 30 31 16.25 12.75", "SIMPLE_RADIAL 32 24 30 16 12 0.8");
  const Frame frame = LoadFrame(ReadColmap(), 0);
  ASSERT_FALSE(frame.mask.empty());
  EXPECT_EQ(frame.mask(0, 0), 0);
  EXPECT_NE(frame.mask(kWidth / 2, kHeight / 2), 0);
  for (size_t i = 0; i < frame.mask.size(); ++i) {
    // The fixture's image has no dark pixel: what is known at all is at least 60 in green.
    if (frame.mask.data()[i] == 0) continue;
    EXPECT_GE(frame.color.data()[i].g, 59) << "black is mixed in at " << i;
  }
}

TEST_F(MasksTest, MasksAreUndistortedWithTheirImages) {
  cameras = Replaced(cameras, "PINHOLE 32 24 30 31 16.25 12.75", "SIMPLE_RADIAL 32 24 30 16 12 -0.2");
  Scene scene = ReadColmap();
  // The stored pixel (28, 20) lies 0.504 from the axis at z = 1, and 0.536 without distortion: at (28.8, 20.5).
  WriteMask("masks/000000.png.png", 28, 20);
  AddMasks(folder() / "masks", &scene);
  const Mask mask = LoadFrame(scene, 0).mask;
  ASSERT_FALSE(mask.empty());
  EXPECT_NE(mask(27, 19), 0);
  EXPECT_EQ(mask(29, 21), 0);
}

}  // namespace
}  // namespace acmp
