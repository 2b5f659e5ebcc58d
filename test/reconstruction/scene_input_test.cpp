// Masks and prior depth: which images have them, what is said of bad ones, and that runs know when they change. And
// images of wide lenses, which become the faces of cubes.

#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "reconstruction/run_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

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
  EXPECT_THAT(log_.str(), HasAll("image 00000001.png takes no part", "ignores every pixel"));
  EXPECT_FALSE(Has("depth/000001.pfm"));
  EXPECT_TRUE(Has("depth/000000.pfm") && Has("depth/000002.pfm") && Has("depth/000003.pfm"));
  for (int image : {0, 2, 3}) WriteMask(image, 0);
  options_.output = output("nothing");
  EXPECT_THAT(Error(), HasAll("--masks", "all masks ignore every pixel"));
}

TEST_F(SceneInputTest, ItIsSaidHowManyImagesHavePriorDepthAndWhyItIsNotUsed) {
  WriteDepth(1, 2);
  WriteDepth(2, 2);
  WriteDepth(3, 0);
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("2 of 4 images have prior depth in " + options_.prior_depth.string()));
  EXPECT_THAT(log_.str(), HasAll("00000003.png: its prior depth", "has no pixel"));
  EXPECT_THAT(log_.str(), HasSubstr("the prior depth of 3 images is not used, for example of 00000001.png: "))
      << "one and the same depth says nothing";
}

TEST_F(SceneInputTest, BadOnesAreRefusedBeforeAnythingIsDone) {
  WriteMask(7, 12);
  EXPECT_THAT(Error(), HasSubstr("none for any of the 4 images"));
  WriteMask(2, 12, kWidth + 2);
  EXPECT_THAT(Error(), HasAll("00000002.png.png", "22 x 15"));
  options_.masks.clear();
  WriteDepth(0, 2);
  std::filesystem::resize_file(options_.prior_depth / "00000000.pfm", 30);
  EXPECT_THAT(Error(), HasSubstr("00000000.pfm"));
  options_.preset = "acmp";
  EXPECT_THAT(Error(), HasAll("--prior-depth", "completion"));
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

/// Images of a fisheye of 190 degrees, 0.25 apart, with a stand-in for the matcher.
class WideImagesTest : public ReconstructRunFixture {
 protected:
  static constexpr int kSize = 40;

  WideImagesTest() {
    std::vector<ColmapModelImage> images;
    for (int i = 0; i < kImages; ++i) {
      ColorImage picture(kSize, kSize);
      RandomStream random(7, static_cast<uint32_t>(i), 0);
      for (Rgb& pixel : picture) pixel.g = static_cast<unsigned char>(random.NextUniform(0, 255));
      const std::string name = Concat(i, i == 2 ? "\xe9.png" : ".png");  // one that is not UTF-8
      std::filesystem::create_directories(folder() / "wide/images");
      WritePng(folder() / "wide/images" / name, picture);
      RigidTransform pose = RigidTransform::Identity();
      pose.translation().x() = -0.25 * i;
      images.push_back({i + 1, name, {kSize, kSize, 12, 12, 19.5, 19.5}, pose, kFisheye});
    }
    WriteColmapModel(folder() / "wide", images, {});
    options_.scene = folder() / "wide";
    options_.field_of_view = 190;
    options_.depth_min = 3;
    options_.depth_max = 5;
  }

  std::vector<ListedCamera> Cameras() const { return ReadCameraList(options_.output / "cameras.txt"); }
  void ExpectFacesOfOtherImagesAsSources() const {
    std::istringstream sources(ReadText(output() / "colmap/stereo/patch-match.cfg"));
    int lines = 0;
    for (std::string name, list; std::getline(sources, name) && std::getline(sources, list); ++lines) {
      std::istringstream words(list);
      for (std::string source; words >> source;) EXPECT_NE(FileOf(source), FileOf(name)) << list;
    }
    EXPECT_EQ(lines, 20);
  }
  /// "12_face_left.png" is of "12".
  static std::string FileOf(const std::string& name) { return name.substr(0, name.find_first_of("_.")); }

  const LensDistortion kFisheye = {LensDistortion::Model::kEquidistant, {0, 0, 0, 0}};
};

TEST_F(WideImagesTest, EachFaceIsAnImageOfItsOwnWithEitherSchedule) {
  options_.colmap = true;
  for (const char* schedule : {"online", "offline"}) {
    options_.schedule = schedule;
    options_.overwrite = true;
    Run(&fake_);
    ExpectFacesOfOtherImagesAsSources();
  }
  EXPECT_THAT(log_.str(), HasSubstr("20 of 20 images are faces of wide ones"));
  const std::vector<ListedCamera> cameras = Cameras();
  ASSERT_EQ(cameras.size(), 20u);
  EXPECT_EQ(cameras[0].image.name, "0.png");
  EXPECT_EQ(cameras[6].image.name, "1_face_left.png");
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Eigen::Vector3d centre(0.25 * static_cast<double>(i / 5), 0, 0);
    EXPECT_NEAR((cameras[i].world_from_cam.translation() - centre).norm(), 0, 1e-9) << cameras[i].image.name;
  }
  EXPECT_TRUE(Has("depth/000019.pfm") && Has("colmap/images/3_face_down.png"));
  // What COLMAP gets are pinhole images, which say no more of a lens.
  const Scene workspace = ReadScene(output() / "colmap", SceneFormat::kColmap);
  ASSERT_EQ(workspace.images.size(), 20u);
  for (size_t i = 0; i < cameras.size(); ++i) {
    EXPECT_EQ(workspace.images[i].distortion.model, LensDistortion::Model::kNone);
    EXPECT_EQ(workspace.images[i].name, cameras[i].image.name);
    EXPECT_NEAR(workspace.images[i].camera.cx, cameras[i].camera.cx, 1e-9);
    EXPECT_TRUE(workspace.images[i].cam_from_world.isApprox(cameras[i].world_from_cam.inverse(), 1e-9));
  }
}

/// Also with a name that is not UTF-8.
TEST_F(WideImagesTest, InterruptedRunsAndStagesEndWithTheSameBytes) {
  RunInterrupted(RunTo("whole") / 2);
  Run(&fake_);
  ExpectSameContents(output("whole"), output());
  std::filesystem::remove_all(output());
  options_.chunk_images = 7;
  options_.plan = folder() / "plan.json";
  Run(&fake_);
  const auto plan = nlohmann::json::parse(ReadText(std::exchange(options_.plan, {})));
  for (const nlohmann::json& task : plan.at("tasks")) {
    Stage(task.at("stage"), task.at("images"), &fake_);
  }
  ExpectSameContents(output("whole"), output());
}

TEST_F(WideImagesTest, CanStayOnePinholeImageEach) {
  options_.wide_faces = "off";
  Run(&fake_);
  ASSERT_EQ(Cameras().size(), 4u);
  EXPECT_EQ(Cameras()[0].camera.width, kSize);
  options_.wide_faces = "auto";
  EXPECT_THAT(Error(), HasSubstr("input")) << "it is another scene now";
  EXPECT_THAT(ErrorWith([](ReconstructOptions* o) { o->field_of_view = 400; }), HasSubstr("--field-of-view = 400"));
}

using WideSceneFiles = TestFolder;

/// Whatever the maps.
TEST_F(WideSceneFiles, FacesOfRefinedPosesMoveAsOne) {
  SyntheticSceneOptions scene = {160, 160, 6};
  scene.field_of_view = 190;
  const std::vector<SyntheticView> views = MakeSyntheticScene(scene);
  WriteSceneFiles(folder() / "scene", views, 0.02f);
  ReconstructOptions options;
  options.scene = folder() / "scene";
  options.output = folder() / "out";
  options.field_of_view = 190;
  options.pose_refinement.refine = RefinePoses::kOn;
  FakeMatcher matcher;
  StopRequest stop;
  std::ostringstream out, log;
  Reconstruct(options, {[&] { return FakeHost(&matcher); }, stop, out, log, false});
  EXPECT_THAT(log.str(), HasSubstr("refined poses are used"));
  const std::vector<PinholeFace> faces = FacesOf(views.front().wide->lens);
  const std::vector<ListedCamera> cameras = ReadCameraList(options.output / "cameras.txt");
  ASSERT_EQ(cameras.size(), faces.size() * views.size());
  double moved = 0;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const RigidTransform& ahead = cameras[i - i % faces.size()].world_from_cam;
    const RigidTransform expected = ahead * RigidTransform(faces[i % faces.size()].lens_from_face);
    EXPECT_TRUE(cameras[i].world_from_cam.isApprox(expected, 1e-9)) << cameras[i].image.name;
    moved += (ahead.translation() - views[i / faces.size()].frame.cam_from_world.inverse().translation()).norm();
  }
  EXPECT_GT(moved, 1e-6);
}

}  // namespace
}  // namespace acmp
