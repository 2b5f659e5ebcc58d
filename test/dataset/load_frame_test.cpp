#include <algorithm>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/scene_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using LoadFrameTest = SceneFixture;

TEST_F(LoadFrameTest, AHeaderThatClaimsAnotherSizeIsRefusedBeforeMemoryIsTaken) {
  const Scene scene = ReadColmap();
  std::string content = ReadText(folder() / "images/000001.png");
  content.replace(16, 8, std::string("\0\0\x3e\x80\0\0\x3e\x80", 8));  // 16000 x 16000: below the general bound
  WriteText("images/000001.png", content);
  EXPECT_REFUSED(LoadFrame(scene, 1), "000001.png: image size 16000 x 16000 differs from its camera's 32 x 24");
}

TEST_F(LoadFrameTest, WrongSizeAndTruncationAreRefused) {
  const Scene scene = ReadColmap();
  WriteImage("images/000001.png", kWidth + 1, kHeight);
  EXPECT_REFUSED(LoadFrame(scene, 1), "000001.png", "33 x 24", "32 x 24");
  const std::string content = ReadText(folder() / "images/000000.png");
  WriteText("images/000000.png", content.substr(0, content.size() / 2));
  EXPECT_REFUSED(LoadFrame(scene, 0), "000000.png");
  EXPECT_REFUSED(LoadFrame(scene, 2), "image index = 2");
}

class MasksTest : public SceneFixture {
 protected:
  /// One black pixel; the others are nearly black.
  void WriteMask(const std::string& name, int col, int row, int width = kWidth) const {
    std::filesystem::create_directories((folder() / name).parent_path());
    ColorImage picture(width, kHeight, {0, 0, 1});
    for (size_t i = 0; i < picture.size(); i += 3) picture.data()[i] = {1, 0, 0};
    for (size_t i = 1; i < picture.size(); i += 3) picture.data()[i] = {0, 1, 0};
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
  EXPECT_REFUSED(AddMasks(folder() / "nowhere", &scene), "nowhere", "does not exist");
  WriteMask("masks/000001.mask.png", 5, 3);
  EXPECT_REFUSED(AddMasks(folder() / "masks", &scene), "none for any of the 2 images", "such as 000000.png.png",
                 "there is 000001.mask.png");
}

TEST_F(MasksTest, AMaskOfAnotherSizeOrKindIsRefused) {
  Scene scene = ReadColmap();
  WriteMask("masks/000000.png.png", 5, 3, kWidth + 1);
  WriteText("masks/000001.png.png", "P5 32 24 255");
  AddMasks(folder() / "masks", &scene);
  EXPECT_REFUSED(LoadFrame(scene, 0), "000000.png.png", "33 x 24", "32 x 24");
  EXPECT_REFUSED(LoadFrame(scene, 1), "000001.png.png", "neither a PNG nor a JPEG");
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

TEST_F(PriorDepthsTest, WhatIsNoneIsRefused) {
  Scene scene = ReadColmap();
  const auto add = [&] { AddPriorDepths(folder() / "depths", &scene); };
  EXPECT_THAT(MessageOf<InvalidInputError>(add), HasSubstr("does not exist"));
  WritePfm(Path("frame.pfm"), Depth(2, 2));
  EXPECT_THAT(MessageOf<InvalidInputError>(add),
              HasAll("none for any of the 2 images", "such as 000000.pfm", "there is frame.pfm"));
  WritePfm(Path("000000.pfm"), Depth(2, 2));
  WriteDmb(Path("000000.dmb"), Depth(2, 2));
  EXPECT_THAT(MessageOf<InvalidInputError>(add), HasAll("two files of prior depth", "000000.dmb"));
  std::filesystem::remove(Path("000000.dmb"));
  WriteText("depths/000000.pfm", "Pf\n2 1\n-1.0\nabcd");
  scene = ReadColmap();
  add();
  EXPECT_REFUSED(LoadFrame(scene, 0), "000000.pfm");
}

class WideSceneTest : public SceneFixture {
 protected:
  /// 183 degrees from left to right and 138 from top to bottom.
  WideSceneTest() {
    cameras = Replaced(cameras, "PINHOLE 32 24 30 31 16.25 12.75", "OPENCV_FISHEYE 32 24 10 10 16 12 0 0 0 0");
    images = Replaced(images, "000001.png", "left/a.png");
    WriteImage("images/left/a.png", kWidth, kHeight);
  }
};

TEST_F(WideSceneTest, BecomesFacesWithOneCentre) {
  const Scene whole = ReadColmap();
  Scene scene = whole;
  SplitWideImages(&scene);
  ASSERT_EQ(scene.images.size(), 10u);
  const std::vector<std::string> names = {"000000.png",          "000000_face_left.png", "000000_face_right.png",
                                          "000000_face_up.png",  "000000_face_down.png", "left/a.png",
                                          "left/a_face_left.png"};
  for (size_t i = 0; i < names.size(); ++i) EXPECT_EQ(scene.images[i].name, names[i]);
  EXPECT_EQ(ImagesOfFile(scene, 3), std::make_pair(0, 5));
  EXPECT_EQ(ImagesOfFile(scene, 5), std::make_pair(5, 10));
  EXPECT_EQ(ImagesOfFile(whole, 1), std::make_pair(1, 2));
  const Lens lens(whole.images[1].camera, whole.images[1].distortion);
  for (int i = 5; i < 10; ++i) {
    const SceneImage& face = scene.images[static_cast<size_t>(i)];
    EXPECT_EQ(face.landmark_indices, whole.images[1].landmark_indices);
    const Frame frame = LoadFrame(scene, i);
    ASSERT_EQ(frame.color.width(), face.camera.width);
    int seen_pixels = 0;
    for (int row = 0; row < frame.color.height(); ++row) {
      for (int col = 0; col < frame.color.width(); ++col) {
        if (!frame.mask.empty() && frame.mask(col, row) == 0) continue;
        const Eigen::Vector3d ray = frame.camera.Unproject({static_cast<double>(col), static_cast<double>(row)});
        const Eigen::Vector3d in_world = frame.cam_from_world.inverse() * (3 * ray);
        const auto seen = lens.Project(whole.images[1].cam_from_world * in_world);
        ASSERT_TRUE(seen);
        // The fixture's colours tell where a pixel comes from.
        EXPECT_NEAR(frame.color(col, row).r, 40 + 4 * seen->x(), 1.5) << face.name;
        EXPECT_NEAR(frame.color(col, row).g, 60 + 3 * seen->y(), 1.5) << face.name;
        ++seen_pixels;
      }
    }
    EXPECT_GT(seen_pixels, 20) << face.name;
  }
}

TEST_F(WideSceneTest, FacesHaveTheMaskAndTheDepthOfTheirImage) {
  Scene scene = ReadColmap();
  ColorImage mask(kWidth, kHeight);  // black, but for its right half
  for (int row = 0; row < kHeight; ++row) {
    for (int col = kWidth / 2; col < kWidth; ++col) mask(col, row) = {255, 255, 255};
  }
  std::filesystem::create_directories(folder() / "masks");
  std::filesystem::create_directories(folder() / "depths");
  WritePng(folder() / "masks/000000.png.png", mask);
  DepthMap distances(1, 1);
  distances(0, 0) = 2;
  WritePfm(folder() / "depths/000000.pfm", distances);
  AddMasks(folder() / "masks", &scene);
  AddPriorDepths(folder() / "depths", &scene);
  SplitWideImages(&scene);
  EXPECT_TRUE(IgnoresAll(LoadFrame(scene, 1).mask)) << "it looks to the left";
  const Frame right = LoadFrame(scene, 2);
  const Eigen::Vector2d middle(right.camera.cx, right.camera.cy);
  const int col = static_cast<int>(std::lround(middle.x())), row = static_cast<int>(std::lround(middle.y()));
  EXPECT_NEAR(right.prior_depth(col, row), 2, 0.01);
  EXPECT_LT(right.prior_depth(0, row), 1.6) << "45 degrees from its axis";
  EXPECT_TRUE(LoadFrame(scene, 5).mask.empty() && LoadFrame(scene, 5).prior_depth.empty());
}

TEST_F(WideSceneTest, RectifiersKeepTheirBound) {
  Scene scene = ReadColmap();
  SplitWideImages(&scene);
  const ColorImage first = LoadFrame(scene, 1).color;
  const size_t of_one = scene.rectifiers->bytes();
  EXPECT_GE(of_one, 7 * first.size());
  LoadFrame(scene, 6);
  EXPECT_EQ(scene.rectifiers->bytes(), of_one) << "the same face of an image of the same camera";
  LoadFrame(scene, 2);
  EXPECT_GT(scene.rectifiers->bytes(), of_one);
  scene.rectifiers->set_max_bytes(of_one);
  for (int i = 9; i > 0; --i) {
    const size_t of_newest = 7 * LoadFrame(scene, i).color.size();
    EXPECT_LE(scene.rectifiers->bytes(), std::max(of_one, of_newest)) << i;
  }
  const ColorImage again = LoadFrame(scene, 1).color;
  const auto is_same = [](const Rgb& a, const Rgb& b) { return ColorDistance(a, b) == 0; };
  EXPECT_TRUE(std::equal(first.begin(), first.end(), again.begin(), again.end(), is_same));
}

TEST_F(WideSceneTest, CirclesAreMaskedAndNamesAreUnique) {
  Scene scene = ReadColmap();
  for (SceneImage& image : scene.images) image.field_of_view = 100;
  SplitWideImages(&scene);
  ASSERT_EQ(scene.images.size(), 2u) << "one pinhole shows them";
  const Mask mask = LoadFrame(scene, 0).mask;
  ASSERT_FALSE(mask.empty());
  EXPECT_EQ(mask(0, 0), 0) << "63 degrees off the axis";
  for (SceneImage& image : scene.images) image.field_of_view = 0;
  EXPECT_TRUE(LoadFrame(scene, 0).mask.empty()) << "a lens of another field was kept";
  WriteImage("images/left/a_face_up.png", kWidth, kHeight);
  images += "9 1 0 0 0 0 0 0 1 left/a_face_up.png\n\n";
  scene = ReadColmap();
  EXPECT_REFUSED(SplitWideImages(&scene), "left/a_face_up.png");
}

}  // namespace
}  // namespace acmp
