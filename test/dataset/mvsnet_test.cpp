#include <gmock/gmock.h>
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/scene_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class MvsnetTest : public SceneFixture {
 protected:
  Scene Read() const {
    WriteMvsnet();
    return ReadScene(folder());
  }
  std::string Error() const {
    return MessageOf<InvalidInputError>([&] { Read(); });
  }
};

TEST_F(MvsnetTest, CamerasPairsAndDepthRanges) {
  const Scene scene = Read();
  ASSERT_EQ(scene.images.size(), 2u);
  EXPECT_EQ(scene.images[0].camera, (PinholeCamera{32, 24, 30, 31, 15.75, 12.25}));  // no half pixel here
  const Eigen::Vector3d moved = scene.images[1].cam_from_world * Eigen::Vector3d(1, 2, 3);
  EXPECT_TRUE(moved.isApprox(Eigen::Vector3d(3.1, 1.2, 2.3), 1e-9));
  EXPECT_THAT(scene.images[0].ranked_sources, ElementsAre(1));
  EXPECT_FLOAT_EQ(scene.images[0].depth_range->min, 0.5f);
  EXPECT_FLOAT_EQ(scene.images[0].depth_range->max, 8.5f);
  EXPECT_FLOAT_EQ(scene.images[1].depth_range->max, 6.0f);  // 1 + 0.5 * (11 - 1)
  EXPECT_TRUE(scene.landmarks_in_world.empty());
  EXPECT_TRUE(scene.warnings.empty());
}

TEST_F(MvsnetTest, TwoDepthNumbersNameNoRange) {
  cam0 = Replaced(cam0, "0.5 0.01 192 8.5", "425 2.5");
  EXPECT_FALSE(Read().images[0].depth_range.has_value());
}

TEST_F(MvsnetTest, LandmarksComeFromTheModelBesideIt) {
  WriteColmapText();
  const Scene scene = Read();
  EXPECT_EQ(scene.landmarks_in_world.size(), 2u);
  EXPECT_THAT(scene.images[0].ranked_sources, ElementsAre(1)) << "pair.txt still counts";
  EXPECT_THAT(scene.images[1].landmark_indices, ElementsAre(0, 1));
  EXPECT_TRUE(ReadScene(folder(), SceneFormat::kColmap).images[0].ranked_sources.empty());
}

TEST_F(MvsnetTest, PixelCentersAreAsSaidAndComparedWithTheModelBesideIt) {
  WriteColmapText();
  EXPECT_TRUE(Read().warnings.empty()) << "15.75 12.25 is COLMAP's 16.25 12.75 with centres at integers";
  for (std::string* cam : {&cam0, &cam1}) *cam = Replaced(*cam, "30 0 15.75\n0 31 12.25", "30 0 16.25\n0 31 12.75");
  EXPECT_THAT(Read().warnings, ElementsAre(HasAll("half, not integer", "--pixel-centers")));
  const Scene half = ReadScene(folder(), SceneFormat::kAuto, ParsePixelCenters("half"));
  EXPECT_TRUE(half.warnings.empty());
  EXPECT_EQ(half.images[1].camera, (PinholeCamera{32, 24, 30, 31, 15.75, 12.25}));
  for (std::string* cam : {&cam0, &cam1}) *cam = Replaced(*cam, "30 0 16.25\n0 31 12.75", "30 0 15.75\n0 31 12.25");
  WriteMvsnet();
  EXPECT_THAT(ReadScene(folder(), SceneFormat::kAuto, PixelCenters::kHalf).warnings,
              ElementsAre(HasSubstr("integer, not half")));
  EXPECT_REFUSED(ReadScene(folder(), SceneFormat::kColmap, PixelCenters::kHalf), "MVSNet scenes only");
  EXPECT_REFUSED(ParsePixelCenters("middle"), "\"middle\"");
}

TEST_F(MvsnetTest, ModelOfOtherPosesOrImagesIsLeftAsideWithAWarning) {
  const std::string good = images;
  images = Replaced(good, "0.1 0.2 0.3", "0.1 0.25 0.3");
  WriteColmapText();
  Scene scene = Read();
  EXPECT_TRUE(scene.landmarks_in_world.empty());
  EXPECT_THAT(scene.warnings, ElementsAre(HasAll("000001.png", "another pose")));
  images = Replaced(good, "000001.png", "other.png");
  WriteColmapText();
  scene = Read();
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("000001.png is not in it")));
}

TEST_F(MvsnetTest, CamerasOfAnotherImageSizeAreWarnedOf) {
  EXPECT_TRUE(Read().warnings.empty());
  cam0 = Replaced(cam0, "30 0 15.75\n0 31 12.25", "60 0 31.5\n0 62 24.5");  // made for 64 x 48, images are half of that
  EXPECT_THAT(Read().warnings, ElementsAre(HasAll("1 of 2 images", "images/000000.png", "cx = 31.5", "in 32 x 24 px",
                                                  "about 64 x 50 px")));
}

TEST_F(MvsnetTest, BadPairs) {
  const auto error = [&](const std::string& text) {
    pairs = text;
    return Error();
  };
  EXPECT_THAT(error("2\n0\n1 1 10.5\n"), HasAll("pair.txt", "truncated"));
  EXPECT_THAT(error("2\n0\n2 1 10.5\n1\n1 0 10.5\n"), HasAll("pair.txt:3", "missing"));
  EXPECT_THAT(error("2\n0\n1 2 10.5\n1\n1 0 10.5\n"), HasSubstr("source view 2"));
  EXPECT_THAT(error("2\n0\n1 0 10.5\n1\n1 0 10.5\n"), HasSubstr("source view 0 of image 0"));
  EXPECT_THAT(error("2\n0\n1 1 10.5\n0\n1 1 10.5\n"), HasSubstr("occurs twice"));
  EXPECT_THAT(error("2\n0\n1 1 nan\n1\n1 0 10.5\n"), HasSubstr("nan"));
}

TEST_F(MvsnetTest, BadCameras) {
  const std::string good = cam1;
  const auto error = [&](const std::string& from, const std::string& to) {
    cam1 = Replaced(good, from, to);
    return Error();
  };
  EXPECT_THAT(error("extrinsic", "intrinsic"), HasAll("00000001_cam.txt:1", "\"extrinsic\""));
  EXPECT_THAT(error("1 0 0 0.2", "1.1 0 0 0.2"), HasAll("extrinsic", "orthonormal"));
  EXPECT_THAT(error("0 1 0 0.3", "0 -1 0 0.3"), HasSubstr("reflection"));
  EXPECT_THAT(error("0 0 0 1", "0 0 0 1.00001"), HasSubstr("is 0 0 0 1.00001"));
  EXPECT_THAT(error("30 0 15.75", "30 1 15.75"), HasSubstr("skew"));
  EXPECT_THAT(error("30 0 15.75", "-30 0 15.75"), HasSubstr("fx = -30"));
  EXPECT_THAT(error("1 0.5 11\n", "5 0.1 10 2\n"), HasAll("_cam.txt:12", "depth range"));
  EXPECT_THAT(error("1 0.5 11\n", "1 0.1 10 1e300\n"), HasSubstr("inf")) << "does not fit a float";
  EXPECT_THAT(error("1 0.5 11\n", ""), HasSubstr("truncated"));
}

TEST_F(MvsnetTest, MissingFilesAreNamed) {
  WriteMvsnet();
  std::filesystem::remove(folder() / "cams/00000001_cam.txt");
  EXPECT_REFUSED(ReadScene(folder()), "00000001_cam.txt");
  WriteMvsnet();
  std::filesystem::remove(folder() / "images/000001.png");
  EXPECT_THAT(Error(), HasAll("image 1 is missing", "00000001"));
  std::filesystem::remove(folder() / "pair.txt");
  EXPECT_REFUSED(ReadScene(folder(), SceneFormat::kMvsnet), "pair.txt");
}

}  // namespace
}  // namespace acmp
