#include <cmath>
#include <cstring>
#include <utility>

#include "acmp_mapping/dataset/scene.h"
#include "dataset/scene_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

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
  cam0 = Replaced(cam0, "0.5 0.01 192 8.5", "425 2.5");
  EXPECT_FALSE(Read().images[0].depth_range) << "two depth numbers name none";
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

TEST_F(MvsnetTest, WithoutNumberOfDepthsTheRangeIsOpen) {
  cam1 = Replaced(cam1, "1 0.5 11\n", "425 2.5\n");  // as MVSNet's files of DTU
  WriteMvsnet();
  const Scene open = ReadScene(folder());
  EXPECT_TRUE(open.images[0].depth_range);
  EXPECT_FALSE(open.images[1].depth_range);
  EXPECT_THAT(open.warnings, ElementsAre(HasAll("00000001_cam.txt", "192", "--depth-max")));
  WriteColmapText();  // with landmarks, which tell the range
  const Scene told = ReadScene(folder(), SceneFormat::kMvsnet);
  EXPECT_FALSE(told.images[1].depth_range);
  EXPECT_THAT(told.warnings, ElementsAre());
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

using Model = LensDistortion::Model;

class ColmapTest : public SceneFixture {
 protected:
  std::string TextError() const {
    return MessageOf<InvalidInputError>([&] { ReadColmap(); });
  }

  static Binary CameraBytes(int32_t model = 1, const std::vector<double>& parameters = {30, 31, 16.25, 12.75}) {
    return Binary().Add<uint64_t>(1).Add<uint32_t>(1).Add(model).Add<uint64_t>(32).Add<uint64_t>(24).AddDoubles(
        parameters);
  }
  static Binary PointBytes() {
    Binary points;
    points.Add<uint64_t>(2);
    for (const auto& [id, xyz] : {std::pair<uint64_t, std::vector<double>>{11, {1, 2, 3}}, {12, {-1.5, 0, 4}}}) {
      points.Add(id).AddDoubles(xyz).Add<uint8_t>(1).Add<uint8_t>(2).Add<uint8_t>(3).Add(0.5);
      points.Add<uint64_t>(1).Add<uint32_t>(7).Add<uint32_t>(0);
    }
    return points;
  }
  static Binary ImageBytes(const std::vector<double>& quaternion = {0.5, 0.5, 0.5, 0.5}) {
    Binary images;
    images.Add<uint64_t>(2);
    images.Add<uint32_t>(7).AddDoubles(quaternion).AddDoubles({0.1, 0.2, 0.3}).Add<uint32_t>(1).AddName("000001.png");
    images.Add<uint64_t>(2).Add(1.0).Add(2.0).Add<uint64_t>(12).Add(3.0).Add(4.0).Add<uint64_t>(UINT64_MAX);
    images.Add<uint32_t>(3).AddDoubles({1, 0, 0, 0, 0, 0, 0}).Add<uint32_t>(1).AddName("000000.png").Add<uint64_t>(0);
    return images;
  }
  Scene ReadBinary(const std::string& cameras, const std::string& images, const std::string& points) const {
    WriteText("sparse/0/cameras.bin", cameras);
    WriteText("sparse/0/images.bin", images);
    WriteText("sparse/0/points3D.bin", points);
    return ReadScene(folder());
  }
  std::string BinaryError(const std::string& cameras, const std::string& images, const std::string& points) const {
    return MessageOf<InvalidInputError>([&] { ReadBinary(cameras, images, points); });
  }
};

void ExpectTheScene(const Scene& scene) {
  ASSERT_EQ(scene.images.size(), 2u);
  const SceneImage& first = scene.images[0];  // the smaller image id comes first
  const SceneImage& second = scene.images[1];
  EXPECT_EQ(first.name, "000000.png");
  EXPECT_EQ(second.name, "000001.png");
  EXPECT_EQ(first.camera, (PinholeCamera{32, 24, 30, 31, 15.75, 12.25}));  // COLMAP's centre minus half a pixel
  EXPECT_EQ(first.distortion.model, Model::kNone);
  EXPECT_TRUE(first.cam_from_world.isApprox(RigidTransform::Identity()));
  // (w x y z) = (0.5 0.5 0.5 0.5) turns x into y, y into z, z into x.
  const Eigen::Vector3d moved = second.cam_from_world * Eigen::Vector3d(1, 2, 3);
  EXPECT_TRUE(moved.isApprox(Eigen::Vector3d(3.1, 1.2, 2.3), 1e-12)) << moved.transpose();
  EXPECT_TRUE(first.landmark_indices.empty());
  ASSERT_FALSE(second.landmark_indices.empty());
  EXPECT_TRUE(scene.landmarks_in_world[second.landmark_indices.back()].isApprox(Eigen::Vector3d(-1.5, 0, 4)));
  EXPECT_FALSE(first.depth_range.has_value());
  EXPECT_TRUE(first.ranked_sources.empty());
}

TEST_F(ColmapTest, TextModel) {
  const Scene scene = ReadColmap();
  ExpectTheScene(scene);
  EXPECT_THAT(scene.images[1].landmark_indices, ElementsAre(0, 1));  // 12 twice and -1 do not count
}

TEST_F(ColmapTest, BinaryModel) {
  ExpectTheScene(ReadBinary(CameraBytes().bytes(), ImageBytes().bytes(), PointBytes().bytes()));
}

TEST_F(ColmapTest, ModelInTheRootAndNamesWithSpaces) {
  WriteImage("images/left eye/a b.png", kWidth, kHeight);
  images = Replaced(images, "000001.png", "left eye/a b.png");
  WriteText("cameras.txt", cameras);
  WriteText("images.txt", images);
  WriteText("points3D.txt", points);
  EXPECT_EQ(ReadScene(folder()).images[1].name, "left eye/a b.png");
}

struct CameraCase {
  std::string name;
  int32_t id;
  std::vector<double> parameters;
  double fy;
  Model model;
  std::vector<double> coefficients;
};

TEST_F(ColmapTest, EveryCameraModelMapsToOpenCv) {
  const std::vector<CameraCase> cases = {
      {"SIMPLE_PINHOLE", 0, {30, 16, 12}, 30, Model::kNone, {}},
      {"PINHOLE", 1, {30, 31, 16, 12}, 31, Model::kNone, {}},
      {"SIMPLE_RADIAL", 2, {30, 16, 12, 0.1}, 30, Model::kBrownConrady, {0.1, 0, 0, 0}},
      {"SIMPLE_RADIAL", 2, {30, 16, 12, 0}, 30, Model::kNone, {}},
      {"RADIAL", 3, {30, 16, 12, 0.1, -0.2}, 30, Model::kBrownConrady, {0.1, -0.2, 0, 0}},
      {"OPENCV", 4, {30, 31, 16, 12, 0.1, -0.2, 0.01, 0.02}, 31, Model::kBrownConrady, {0.1, -0.2, 0.01, 0.02}},
      {"OPENCV_FISHEYE", 5, {30, 31, 16, 12, 0.1, 0.2, 0.3, 0.4}, 31, Model::kEquidistant, {0.1, 0.2, 0.3, 0.4}},
      {"FULL_OPENCV", 6, {30, 31, 16, 12, 1, 2, 3, 4, 5, 6, 7, 8}, 31, Model::kRational, {1, 2, 3, 4, 5, 6, 7, 8}},
      {"SIMPLE_RADIAL_FISHEYE", 8, {30, 16, 12, 0}, 30, Model::kEquidistant, {0, 0, 0, 0}},
      {"SIMPLE_FISHEYE", 14, {30, 16, 12}, 30, Model::kEquidistant, {0, 0, 0, 0}},
      {"FISHEYE", 15, {30, 31, 16, 12}, 31, Model::kEquidistant, {0, 0, 0, 0}},
      {"EUCM", 16, {30, 31, 16, 12, 0.6, 1.1}, 31, Model::kExtendedUnified, {0.6, 1.1}},
      {"RADIAL_FISHEYE", 9, {30, 16, 12, 0.1, 0.2}, 30, Model::kEquidistant, {0.1, 0.2, 0, 0}}};
  const std::string text_cameras = cameras;
  for (const CameraCase& c : cases) {
    std::string line = c.name + " 32 24";
    for (double parameter : c.parameters) line += Concat(" ", parameter);
    cameras = Replaced(text_cameras, "PINHOLE 32 24 30 31 16.25 12.75", line);
    std::filesystem::remove_all(folder() / "sparse");
    const Scene text = ReadColmap();
    std::filesystem::remove_all(folder() / "sparse");
    const Scene binary =
        ReadBinary(CameraBytes(c.id, c.parameters).bytes(), ImageBytes().bytes(), PointBytes().bytes());
    for (const Scene* scene : {&text, &binary}) {
      const SceneImage& image = scene->images[0];
      EXPECT_EQ(image.distortion.model, c.model) << line;
      EXPECT_EQ(image.distortion.coefficients, c.coefficients) << line;
      EXPECT_EQ(image.camera, (PinholeCamera{32, 24, 30, c.fy, 15.5, 11.5})) << line;
    }
  }
}

TEST_F(ColmapTest, APanoramaIsItsSizeAlone) {
  cameras = "1 EQUIRECTANGULAR 32 16 32 16\n";
  const SceneImage image = ReadColmap().images[0];
  EXPECT_EQ(image.distortion.model, Model::kEquirectangular);
  // COLMAP: x = (atan2(u, w) / (2 pi) + 0.5) * width, with pixel centres at +0.5.
  EXPECT_NEAR(Lens(image.camera, image.distortion).Project({1, 0, 0})->x(), 0.75 * 32 - 0.5, 1e-9);
  cameras = "1 EQUIRECTANGULAR 32 24 32 24\n";
  EXPECT_THAT(TextError(), HasAll("cameras.txt:1", "twice as wide as high"));
}

TEST_F(ColmapTest, OtherCameraModelsAreRefusedByName) {
  for (const char* name : {"FOV", "THIN_PRISM_FISHEYE", "DIVISION", "MY_OWN"}) {
    cameras = std::string("1 ") + name + " 32 24 30 31 16 12 0.1\n";
    EXPECT_THAT(TextError(), HasAll("cameras.txt:1", name, "OPENCV_FISHEYE"));
  }
  std::filesystem::remove_all(folder() / "sparse");
  EXPECT_THAT(BinaryError(CameraBytes(7).bytes(), "", ""), HasAll("cameras.bin", "id 7 (FOV)"));
  EXPECT_THAT(BinaryError(CameraBytes(99).bytes(), "", ""), HasSubstr("id 99"));
  EXPECT_THAT(BinaryError(CameraBytes(-1).bytes(), "", ""), HasSubstr("id -1"));
}

TEST_F(ColmapTest, BadPoses) {
  const std::string good = images;
  const auto error = [&](const std::string& pose) {
    images = Replaced(good, "0.5 0.5 0.5 0.5 0.1 0.2 0.3", pose);
    return TextError();
  };
  EXPECT_THAT(error("nan 0.5 0.5 0.5 0.1 0.2 0.3"), HasAll("images.txt:3", "nan"));
  EXPECT_THAT(error("0.6 0.5 0.5 0.5 0.1 0.2 0.3"), HasAll("images.txt:3", "length 1.05"));
  images = Replaced(good, "0.5 0.5 0.5 0.5 0.1", "0.5003 0.5 0.5 0.5 0.1");  // length 1.00015: rounding, accepted
  const Eigen::Matrix3d rotation = ReadColmap().images[1].cam_from_world.linear();
  EXPECT_LT((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  std::filesystem::remove_all(folder() / "sparse");
  EXPECT_THAT(BinaryError(CameraBytes().bytes(), ImageBytes({NAN, 0, 0, 1}).bytes(), PointBytes().bytes()),
              HasAll("images.bin", "quaternion = nan"));
  EXPECT_THAT(BinaryError(CameraBytes().bytes(), ImageBytes({2, 0, 0, 0}).bytes(), PointBytes().bytes()),
              HasSubstr("length 2"));
}

TEST_F(ColmapTest, BadTextIsNamedWithItsPlace) {
  const auto expect_error = [&](std::string* text, const std::string& from, const std::string& to,
                                const std::string& words) {
    const std::string good = std::exchange(*text, Replaced(*text, from, to));
    EXPECT_THAT(TextError(), HasSubstr(words)) << to;
    *text = good;
  };
  expect_error(&cameras, "30 31 16.25 12.75", "30 31 16.25", "missing");
  expect_error(&cameras, "30 31 16.25", "0 31 16.25", "fx = 0");
  expect_error(&cameras, "12.75", "12x", "\"12x\"");
  expect_error(&cameras, "12.75", "12.75 9", "unexpected \"9\"");
  expect_error(&cameras, "1 PINHOLE 32 24", "1 PINHOLE 32 2147483648", "height = 2147483648");
  expect_error(&cameras, "12.75\n", "12.75\n1 PINHOLE 32 24 30 31 16 12\n", "camera id 1 occurs twice");
  expect_error(&images, "0.3 1 000001.png", "0.3 5 000001.png", "camera id 5");
  expect_error(&images, "5 6 11", "5 6 13", "point id 13");
  expect_error(&images, "3 1 0 0 0", "7 1 0 0 0", "image id 7 occurs twice");
  expect_error(&images, "000000.png", "000001.png", "000001.png occurs twice");
  expect_error(&images, "1 2 12 3.5", "1 2 12 3.5 9", "images.txt:4");           // not groups of three
  expect_error(&points, "12 -1.5 0 4e0 10 20 30 0.5 7 0\n", "", "point id 12");  // cut off
}

TEST_F(ColmapTest, FewerRecordsThanTheHeaderAnnouncesAreAWarning) {
  images = Replaced(images, "3 1 0 0 0 0 0 0 1 000000.png\n\n", "");
  const Scene scene = ReadColmap();
  EXPECT_EQ(scene.images.size(), 1u);
  EXPECT_THAT(scene.warnings, ElementsAre(HasAll("images.txt", "after 1 images", "announces 2")));
}

TEST_F(ColmapTest, ReadsTextAsOtherProgramsAndEditorsLeaveIt) {
  const std::string good_cameras = cameras, good_images = images;
  cameras = "\xEF\xBB\xBF" + Replaced(cameras, "PINHOLE 32 24", "PINHOLE 32.0 24.");
  ExpectTheScene(ReadColmap());
  cameras = Replaced(good_cameras, "PINHOLE 32 24", "PINHOLE 32.5 24");
  EXPECT_THAT(TextError(), HasAll("cameras.txt", "32.5", "whole number"));
  cameras =
      "\xEF\xBB\xBF"
      "1 PINHOLE 32 24 30 31 16.25 12.75\n";
  for (const char* end : {"000000.png\n", "000000.png"}) {  // no line of features behind the last image
    images = Replaced(good_images, "000000.png\n\n", end);
    const Scene scene = ReadColmap();
    ExpectTheScene(scene);
    EXPECT_THAT(scene.warnings, ElementsAre());
  }
  images = "3 1 0 0 0 0 0 0 1 000000.png\n7 0.5 0.5 0.5 0.5 0.1 0.2 0.3 1 000001.png\n1 2 12 3.5 4.5 -1 5 6 11\n";
  ExpectTheScene(ReadColmap());
}

TEST_F(ColmapTest, WithoutTracksPointsAreThoseThatProjectIntoTheImage) {
  images = Replaced(images, "1 2 12 3.5 4.5 -1 5 6 11 1.5 2 12", "");
  // Before the first image (z > 0) lie the first two; the third is behind it, the fourth beside what it sees.
  points = "11 0 0 4 10 20 30 0.5\n12 0.5 0.2 5 10 20 30 0.5\n13 0 0 -4 10 20 30 0.5\n14 9 0 4 10 20 30 0.5\n";
  const Scene scene = ReadColmap();
  EXPECT_THAT(scene.images[0].landmark_indices, ElementsAre(0, 1));
  EXPECT_THAT(scene.warnings, ElementsAre(HasAll("tracks", "4 points")));
}

TEST_F(ColmapTest, FeaturesFarFromTheirLandmarksAreTold) {
  const auto warnings = [&](double off, double shift_of_camera) {
    std::string features;
    points.clear();
    const PinholeCamera camera{32, 24, 30, 31, 15.75, 12.25};
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector3d point(0.1 * i - 0.5, 0.05 * i - 0.2, 3 + 0.1 * i);
      const Eigen::Vector2d pixel = camera.Project(point);
      features += Concat(pixel.x() + 0.5 + off, " ", pixel.y() + 0.5, " ", i, " ");
      points += Concat(i, " ", point.x(), " ", point.y(), " ", point.z(), " 1 2 3 0.5\n");
    }
    images =
        Concat("3 1 0 0 0 ", shift_of_camera, " 0 0 1 000000.png\n", features, "\n7 1 0 0 0 0 0 0 1 000001.png\n\n");
    return ReadColmap().warnings;
  };
  EXPECT_THAT(warnings(0.3, 0), ElementsAre());
  EXPECT_THAT(warnings(0, 2), ElementsAre(HasAll("1 of 1 images", "000000.png", "too few digits")));
  EXPECT_THAT(warnings(20, 0), ElementsAre(HasAll("features and landmarks", "20 px")));
}

TEST_F(ColmapTest, MissingImageFileIsNamed) {
  std::filesystem::remove(folder() / "images/000001.png");
  const Scene scene = ReadColmap();
  ASSERT_EQ(scene.images.size(), 1u) << "the others are used";
  EXPECT_EQ(scene.images[0].name, "000000.png");
  EXPECT_THAT(scene.warnings, ElementsAre(HasAll("1 of 2 images", "images/000001.png")));
  std::filesystem::remove(folder() / "images/000000.png");
  EXPECT_THAT(TextError(), HasAll("none of the 2 images", "--image-path"));
}

TEST_F(ColmapTest, ImagesOfAnotherFolder) {
  std::filesystem::rename(folder() / "images", folder() / "pictures");
  EXPECT_THAT(TextError(), HasAll("none of the 2 images", "--image-path"));
  const Scene scene = ReadScene(folder(), SceneFormat::kAuto, PixelCenters::kInteger, folder() / "pictures");
  EXPECT_EQ(scene.images[0].path, folder() / "pictures/000000.png");
}

TEST_F(ColmapTest, EveryTruncationOfBinaryFilesIsRefused) {
  const std::string good[] = {CameraBytes().bytes(), ImageBytes().bytes(), PointBytes().bytes()};
  const char* names[] = {"cameras.bin", "images.bin", "points3D.bin"};
  for (int file = 0; file < 3; ++file) {
    for (size_t length = 0; length < good[file].size(); ++length) {
      std::string parts[] = {good[0], good[1], good[2]};
      parts[file].resize(length);
      EXPECT_THAT(BinaryError(parts[0], parts[1], parts[2]), HasSubstr(names[file])) << "cut to " << length;
    }
    std::string parts[] = {good[0], good[1], good[2]};
    parts[file] += 'x';
    EXPECT_THAT(BinaryError(parts[0], parts[1], parts[2]), HasAll(names[file], "too many"));
  }
}

TEST_F(ColmapTest, HugeCountsInBinaryFilesTakeNoMemory) {
  const auto huge = [](std::string bytes, size_t at) {
    const uint64_t count = uint64_t{1} << 61;
    std::memcpy(&bytes[at], &count, sizeof(count));
    return bytes;
  };
  const std::string c = CameraBytes().bytes();
  const std::string i = ImageBytes().bytes();
  const std::string p = PointBytes().bytes();
  EXPECT_THAT(BinaryError(huge(c, 0), i, p), HasSubstr("number of cameras: 2305843009213693952"));
  EXPECT_THAT(BinaryError(c, huge(i, 0), p), HasSubstr("number of images: 2305843009213693952"));
  EXPECT_THAT(BinaryError(c, i, huge(p, 0)), HasSubstr("number of points: 2305843009213693952"));
  const size_t features = 8 + 4 + 7 * 8 + 4 + 11;
  EXPECT_THAT(BinaryError(c, huge(i, features), p), HasSubstr("number of features: 2305843009213693952"));
  EXPECT_THAT(BinaryError(c, i, huge(p, 8 + 8 + 24 + 3 + 8)), HasSubstr("track length: 2305843009213693952"));
}

TEST_F(ColmapTest, EmptyModelAndNoModelAreRefused) {
  EXPECT_REFUSED(ReadScene(folder()), "no COLMAP model");
  EXPECT_REFUSED(ReadScene(folder() / "none"), "does not exist");
  EXPECT_REFUSED(ReadScene(WriteText("file", "x")), "not a folder");
  images = "# nothing\n";
  EXPECT_THAT(TextError(), HasSubstr("no images"));
}

}  // namespace
}  // namespace acmp
