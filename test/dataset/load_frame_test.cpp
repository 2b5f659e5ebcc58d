#include <gmock/gmock.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/scene_fixture.h"
#include "support/lens.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

using LoadFrameTest = SceneFixture;

TEST_F(LoadFrameTest, FrameHasImagePoseAndObservedLandmarks) {
  const Frame frame = LoadFrame(ReadColmap(), 1);
  EXPECT_EQ(frame.id, 1);
  EXPECT_EQ(frame.color.width(), kWidth);
  EXPECT_EQ(frame.gray.height(), kHeight);
  EXPECT_EQ(frame.color(5, 3).r, 60);
  EXPECT_EQ(frame.landmarks_in_world.size(), 2u);
  EXPECT_TRUE(LoadFrame(ReadColmap(), 0).landmarks_in_world.empty());
}

TEST_F(LoadFrameTest, MaxSizeScalesImageAndCamera) {
  const Frame frame = LoadFrame(ReadColmap(), 0, {16});
  EXPECT_EQ(frame.camera, (PinholeCamera{16, 12, 15, 15.5, 16.25 / 2 - 0.5, 12.75 / 2 - 0.5}));
  EXPECT_EQ(frame.color.width(), 16);
}

TEST_F(LoadFrameTest, AHeaderThatClaimsAnotherSizeIsRefusedBeforeMemoryIsTaken) {
  const Scene scene = ReadColmap();
  std::string content = ReadText(folder() / "images/000001.png");
  content.replace(16, 8, std::string("\0\0\x3e\x80\0\0\x3e\x80", 8));  // 16000 x 16000: below the general bound
  WriteText("images/000001.png", content);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 1); }),
              HasSubstr("000001.png: image size 16000 x 16000 differs from its camera's 32 x 24"));
}

TEST_F(LoadFrameTest, WrongSizeAndTruncationAreRefused) {
  const Scene scene = ReadColmap();
  WriteImage("images/000001.png", kWidth + 1, kHeight);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 1); }),
              AllOf(HasSubstr("000001.png"), HasSubstr("33 x 24"), HasSubstr("32 x 24")));
  const std::string content = ReadText(folder() / "images/000000.png");
  WriteText("images/000000.png", content.substr(0, content.size() / 2));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 0); }), HasSubstr("000000.png"));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 2); }), HasSubstr("image index = 2"));
}

TEST_F(LoadFrameTest, UndistortsEveryModel) {
  const std::string good = cameras;
  for (const char* model : {"SIMPLE_RADIAL 32 24 30 16 12 -0.2", "RADIAL 32 24 30 16 12 -0.2 0.05",
                            "OPENCV 32 24 30 31 16 12 -0.2 0.05 0.01 -0.02",
                            "FULL_OPENCV 32 24 30 31 16 12 0.1 -0.05 0.01 -0.02 0.02 0.2 0.03 0.01",
                            "OPENCV_FISHEYE 32 24 30 31 16 12 0.05 -0.02 0.01 0.003",
                            "SIMPLE_RADIAL_FISHEYE 32 24 30 16 12 0.05", "RADIAL_FISHEYE 32 24 30 16 12 0.05 -0.02"}) {
    cameras = Replaced(good, "PINHOLE 32 24 30 31 16.25 12.75", model);
    const Scene scene = ReadColmap();
    const Frame frame = LoadFrame(scene, 0);
    EXPECT_EQ(frame.camera, scene.images[0].camera);
    int inside = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        const PinholeCamera& camera = scene.images[0].camera;
        const Eigen::Vector2d p = test::Distort(camera, scene.images[0].distortion, (col - camera.cx) / camera.fx,
                                                (row - camera.cy) / camera.fy);
        if (p.x() < 0 || p.y() < 0 || p.x() > kWidth - 1 || p.y() > kHeight - 1) continue;
        ++inside;
        // The fixture's image is linear, so interpolation is exact up to remap's steps of 1/32 px (4 levels per px:
        // 0.06) and rounding (0.5).
        EXPECT_NEAR(frame.color(col, row).r, 40 + 4 * p.x(), 0.7) << model << " at " << col << " " << row;
        EXPECT_NEAR(frame.color(col, row).g, 60 + 3 * p.y(), 0.7) << model << " at " << col << " " << row;
      }
    }
    EXPECT_GT(inside, kWidth * kHeight / 2) << model;
  }
}

TEST(ParseImageIndices, TakesIndicesAndRanges) {
  EXPECT_EQ(ParseImageIndices("3,0-1,3", 4), (std::vector<int>{0, 1, 3}));
  EXPECT_EQ(ParseImageIndices("2", 3), std::vector<int>{2});
}

}  // namespace
}  // namespace acmp
