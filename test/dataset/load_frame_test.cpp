#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/scene_fixture.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;
using Model = LensDistortion::Model;

class LoadFrameTest : public SceneFixture {
 protected:
  Scene Read() const {
    WriteColmapText();
    return ReadScene(folder());
  }
};

TEST_F(LoadFrameTest, FrameHasImagePoseAndObservedLandmarks) {
  const Frame frame = LoadFrame(Read(), 1);
  EXPECT_EQ(frame.id, 1);
  EXPECT_EQ(frame.color.width(), kWidth);
  EXPECT_EQ(frame.gray.height(), kHeight);
  EXPECT_EQ(frame.color(5, 3).r, 60);
  EXPECT_EQ(frame.landmarks_in_world.size(), 2u);
  EXPECT_TRUE(LoadFrame(Read(), 0).landmarks_in_world.empty());
}

TEST_F(LoadFrameTest, MaxSizeScalesImageAndCamera) {
  const Frame frame = LoadFrame(Read(), 0, {16});
  EXPECT_EQ(frame.camera, (PinholeCamera{16, 12, 15, 15.5, 16.25 / 2 - 0.5, 12.75 / 2 - 0.5}));
  EXPECT_EQ(frame.color.width(), 16);
}

TEST_F(LoadFrameTest, AHeaderThatClaimsAnotherSizeIsRefusedBeforeMemoryIsTaken) {
  const Scene scene = Read();
  std::string content = ReadText(folder() / "images/000001.png");
  content.replace(16, 8, std::string("\0\0\x3e\x80\0\0\x3e\x80", 8));  // 16000 x 16000: below the general bound
  WriteText("images/000001.png", content);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 1); }),
              HasSubstr("000001.png: image size 16000 x 16000 differs from its camera's 32 x 24"));
}

TEST_F(LoadFrameTest, WrongSizeAndTruncationAreRefused) {
  const Scene scene = Read();
  WriteImage("images/000001.png", kWidth + 1, kHeight);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 1); }),
              AllOf(HasSubstr("000001.png"), HasSubstr("33 x 24"), HasSubstr("32 x 24")));
  const std::string content = ReadText(folder() / "images/000000.png");
  WriteText("images/000000.png", content.substr(0, content.size() / 2));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 0); }), HasSubstr("000000.png"));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { LoadFrame(scene, 2); }), HasSubstr("image index = 2"));
}

/// Where a pixel of the undistorted image lies in the stored one: the models' formulas as OpenCV and COLMAP document
/// them.
Eigen::Vector2d Distort(const PinholeCamera& camera, const LensDistortion& distortion, double col, double row) {
  const auto& k = distortion.coefficients;
  const double x = (col - camera.cx) / camera.fx;
  const double y = (row - camera.cy) / camera.fy;
  const double r2 = x * x + y * y;
  double xd = x;
  double yd = y;
  if (distortion.model == Model::kEquidistant) {
    const double r = std::sqrt(r2);
    const double t = std::atan(r);
    const double t2 = t * t;
    const double scale =
        r > 0 ? t * (1 + k[0] * t2 + k[1] * t2 * t2 + k[2] * std::pow(t2, 3) + k[3] * std::pow(t2, 4)) / r : 1;
    xd = x * scale;
    yd = y * scale;
  } else {
    const auto c = [&](size_t i) { return i < k.size() ? k[i] : 0.0; };
    const double radial =
        (1 + c(0) * r2 + c(1) * r2 * r2 + c(4) * r2 * r2 * r2) / (1 + c(5) * r2 + c(6) * r2 * r2 + c(7) * r2 * r2 * r2);
    xd = x * radial + 2 * c(2) * x * y + c(3) * (r2 + 2 * x * x);
    yd = y * radial + c(2) * (r2 + 2 * y * y) + 2 * c(3) * x * y;
  }
  return {xd * camera.fx + camera.cx, yd * camera.fy + camera.cy};
}

TEST_F(LoadFrameTest, UndistortsEveryModel) {
  const std::string good = cameras;
  for (const char* model : {"SIMPLE_RADIAL 32 24 30 16 12 -0.2", "RADIAL 32 24 30 16 12 -0.2 0.05",
                            "OPENCV 32 24 30 31 16 12 -0.2 0.05 0.01 -0.02",
                            "FULL_OPENCV 32 24 30 31 16 12 0.1 -0.05 0.01 -0.02 0.02 0.2 0.03 0.01",
                            "OPENCV_FISHEYE 32 24 30 31 16 12 0.05 -0.02 0.01 0.003",
                            "SIMPLE_RADIAL_FISHEYE 32 24 30 16 12 0.05", "RADIAL_FISHEYE 32 24 30 16 12 0.05 -0.02"}) {
    cameras = Replaced(good, "PINHOLE 32 24 30 31 16.25 12.75", model);
    const Scene scene = Read();
    const Frame frame = LoadFrame(scene, 0);
    EXPECT_EQ(frame.camera, scene.images[0].camera);
    int inside = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        const Eigen::Vector2d p = Distort(scene.images[0].camera, scene.images[0].distortion, col, row);
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
