#include "acmp_mapping/reconstruction/reconstruct.h"

#include <set>

#include "acmp_mapping/dataset/map_io.h"
#include "plan.h"
#include "progress.h"
#include "reconstruction/run_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ReconstructTest = ReconstructRunFixture;

TEST_F(ReconstructTest, WritesEveryFileItPromises) {
  options_.dmb = true;
  Run(&fake_);
  for (const char* index : {"000000", "000001", "000002", "000003"}) {
    const std::string i = index;
    for (const std::string& name :
         {"depth/" + i + ".pfm", "depth/" + i + ".png", "depth/" + i + ".dmb", "normal/" + i + ".pfm",
          "cost/" + i + ".pfm", "confidence/" + i + ".pfm", "pictures/" + i + "_depth.png",
          "pictures/" + i + "_normal.png", "pictures/" + i + "_cost.png", "pictures/" + i + "_confidence.png"}) {
      EXPECT_TRUE(Has(name)) << name;
    }
  }
  EXPECT_FALSE(Has("work") || Has("colmap"));
  EXPECT_EQ(ReadDepth(output() / "depth/000002.pfm").width(), kWidth);
  EXPECT_EQ(ReadPfmNormals(output() / "normal/000002.pfm")(3, 3).z, -1.0f);
  EXPECT_FALSE(ReadPly(output() / "fused.ply").vertices.empty());
  EXPECT_THAT(ReadText(output() / "summary.json"), HasSubstr("\"images_with_map\": 4"));
}

TEST_F(ReconstructTest, WritesTheMapsAskedFor) {
  Run(&fake_);
  const std::string cloud = ReadText(output() / "fused.ply");
  const std::string depth = ReadText(output() / "depth/000001.pfm");

  options_.output = output("depth_only");
  options_.maps = {"depth"};
  Run(&fake_);
  EXPECT_FALSE(Has("depth/000001.dmb"));
  EXPECT_EQ(ReadText(options_.output / "depth/000001.pfm"), depth);
  EXPECT_TRUE(Has("depth/000001.png") && Has("pictures/000001_depth.png"));
  EXPECT_FALSE(Has("normal") || Has("cost") || Has("confidence") || Has("pictures/000001_normal.png"));
  EXPECT_EQ(ReadText(options_.output / "fused.ply"), cloud);

  options_.output = output("no_pictures");
  options_.no_pictures = true;
  Run(&fake_);
  EXPECT_FALSE(Has("pictures"));

  options_.output = output("cloud_only");
  options_.maps = {};
  Run(&fake_);
  EXPECT_FALSE(Has("depth") || Has("pictures"));
  EXPECT_EQ(ReadText(options_.output / "fused.ply"), cloud);
  EXPECT_TRUE(Has("cameras.txt"));
  Run(&fake_);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
}

TEST_F(ReconstructTest, CamerasFileHasTheMapsSizeAndPoses) {
  options_.max_image_size = 10;
  Run(&fake_);
  const std::vector<ListedCamera> cameras = ReadCameraList(output() / "cameras.txt");
  ASSERT_EQ(cameras.size(), size_t{kImages});
  EXPECT_EQ(cameras[1].image.index, 1);
  EXPECT_EQ(cameras[1].image.name, "00000001.png");
  const PinholeCamera& camera = cameras[1].camera;
  EXPECT_EQ(camera.width, 10);
  EXPECT_EQ(camera.height, 8);  // 7.5 rounded
  EXPECT_DOUBLE_EQ(camera.fx, kWidth / 2.0);
  EXPECT_DOUBLE_EQ(camera.cx, (9.5 + 0.5) / 2 - 0.5);
  EXPECT_NEAR(cameras[1].world_from_cam.translation().x(), kSpacing, 1e-12);
  EXPECT_EQ(ReadPfm(output() / "depth/000001.pfm").width(), 10);
}

TEST_F(ReconstructTest, PosesAreRefinedWhereThatHelps) {
  WriteScene(10, 160, 120);
  options_.maps = {};
  Run(&fake_);
  const std::string given = ReadText(output() / "cameras.txt");
  EXPECT_THAT(log_.str(), Not(HasSubstr("poses:")));

  options_.pose_refinement.refine = RefinePoses::kAuto;
  options_.output = output("exact");
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("poses stay as they are"));
  EXPECT_EQ(ReadText(options_.output / "cameras.txt"), given);

  // Half a degree about x.
  std::string camera = ReadText(scene() / "cams/00000002_cam.txt");
  const std::string upright = "0 1 0 0\n0 0 1 0\n";
  ASSERT_NE(camera.find(upright), std::string::npos);
  camera.replace(camera.find(upright), upright.size(), "0 0.9999619 -0.0087265 0\n0 0.0087265 0.9999619 0\n");
  WriteText("scene/cams/00000002_cam.txt", camera);
  options_.output = output("turned");
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("refined poses are used"));
  const RigidTransform refined = ReadCameraList(options_.output / "cameras.txt").at(2).world_from_cam;
  EXPECT_NEAR(refined.linear()(1, 2), 0, 0.002);
  EXPECT_THAT(ReadText(options_.output / "summary.json"), HasSubstr("\"refine-poses\": \"auto\""));
}

TEST_F(ReconstructTest, EachStepReadsTheMapsAfterTheStepBefore) {
  options_.preset = "acmh";
  options_.set = {"geometric_passes=2"};
  Run(&fake_);
  std::map<std::string, std::set<uint32_t>> results;  // by pass
  for (const auto& call : fake_.calls) results[call.pass].insert(call.result_hash);
  const std::map<std::string, std::string> before = {{"geometric 0", "photometric"}, {"geometric 1", "geometric 0"}};
  for (const auto& call : fake_.calls) {
    ASSERT_EQ(call.source_hashes.size(), kImages - 1u);
    const auto read = before.find(call.pass);
    for (uint32_t hash : call.source_hashes) {
      if (read == before.end()) {
        EXPECT_EQ(hash, 0u) << "photometric passes get no depth";
      } else {
        EXPECT_EQ(results[read->second].count(hash), 1u) << call.pass << " read a map of another step";
      }
    }
  }
  EXPECT_EQ(results.size(), 3u);
}

TEST_F(ReconstructTest, FoldersOfOthersAreNeverTouched) {
  options_.overwrite = true;
  WriteText("out/depth/000000.png", "precious");
  EXPECT_THAT(Error(), HasSubstr("holds depth and was not made by this tool"));
  WriteText("out/run.txt", "my notes of the run of Tuesday");
  EXPECT_THAT(Error(), HasSubstr("not made by this tool")) << "a file of that name makes it no folder of ours";
  EXPECT_EQ(ReadText(output() / "depth/000000.png"), "precious");
  EXPECT_FALSE(std::filesystem::exists(output() / ".lock")) << "left in a folder of others";
  for (const auto& folder : {scene(), scene().parent_path(), scene() / "../scene"}) {
    options_.output = folder;
    EXPECT_THAT(Error(), HasSubstr("holds SCENE = "));
  }
  EXPECT_TRUE(std::filesystem::exists(scene() / "pair.txt"));
  EXPECT_TRUE(fake_.calls.empty());
}

TEST_F(ReconstructTest, AnImageThatIsWrittenDuringTheRunFailsIt) {
  fake_.on_call = [&](int call) {
    if (call == 2) WriteText("scene/images/00000003.png", ReadText(scene() / "images/00000002.png"));
  };
  EXPECT_THAT(MessageOf<ProcessingError>([&] { Run(&fake_); }), HasAll("00000003.png", "has changed during the run"));
  EXPECT_FALSE(Has("summary.json") || Has("fused.ply") || Has("work"));
}

TEST_F(ReconstructTest, TwoRunsAtOnceAreRefused) {
  std::string message;
  fake_.on_call = [&](int call) {
    FakeMatcher other;
    if (call == 0) message = ErrorOf(&other);
  };
  Run(&fake_);
  EXPECT_THAT(message, HasSubstr("another run is writing"));
}

TEST_F(ReconstructTest, DamagedImageIsFoundBeforeTheFirstPass) {
  const auto image = scene() / "images/00000003.png";
  std::filesystem::resize_file(image, std::filesystem::file_size(image) / 2);
  EXPECT_THAT(Error(), HasSubstr("00000003.png"));
  EXPECT_TRUE(fake_.calls.empty());
  EXPECT_FALSE(std::filesystem::exists(output()));
}

TEST_F(ReconstructTest, ImagesWithoutSourceViewsAreNamedAndLeftOut) {
  // Image 3 names no sources; without landmarks a grid at the middle depth decides, and it looks the other way.
  WriteText("scene/pair.txt", "4\n0\n2 1 1 2 1\n1\n2 0 1 2 1\n2\n2 1 1 0 1\n3\n0\n");
  std::string camera = ReadText(scene() / "cams/00000003_cam.txt");
  camera.replace(camera.find("1 0 0 "), 6, "-1 0 0 ");
  camera.replace(camera.find("0 0 1 0"), 7, "0 0 -1 0");
  WriteText("scene/cams/00000003_cam.txt", camera);
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("no map for image 00000003.png: 0 useful source views"));
  EXPECT_FALSE(Has("depth/000003.pfm"));
  EXPECT_TRUE(Has("depth/000002.pfm"));
  EXPECT_THAT(ReadText(output() / "summary.json"), HasSubstr("\"name\": \"00000003.png\""));
  options_.output = output("strict");
  options_.min_source_views = 3;
  EXPECT_THAT(Error(), HasAll("none of the 4 images", "must be at least 3"));
}

TEST_F(ReconstructTest, SourceWithoutBaselineIsLeftOutWithAWarning) {
  WriteText("scene/cams/00000001_cam.txt", ReadText(scene() / "cams/00000000_cam.txt"));
  Run(&fake_);
  EXPECT_THAT(log_.str(), HasSubstr("image 00000000.png: source view 00000001.png is left out"));
  EXPECT_TRUE(Has("depth/000000.pfm"));
}

TEST_F(ReconstructTest, SourceViewsAreLimitedInTheDatasetsOrder) {
  options_.source_views = 2;
  Run(&fake_);
  for (const auto& call : fake_.calls) EXPECT_EQ(call.source_hashes.size(), 2u);
}

TEST_F(ReconstructTest, SubsetKeepsTheScenesIndices) {
  options_.images = "1-2";
  Run(&fake_);
  EXPECT_TRUE(Has("depth/000001.pfm"));
  EXPECT_FALSE(Has("depth/000000.pfm"));
  for (const auto& call : fake_.calls) EXPECT_EQ(call.source_hashes.size(), 1u);
  options_.images = "1-4";
  EXPECT_THAT(Error(), HasSubstr("\"1-4\""));
}

TEST_F(ReconstructTest, DepthRangeMustComeFromSomewhere) {
  const auto take_range = [&](int image) {
    const std::string name = "scene/cams/0000000" + std::to_string(image) + "_cam.txt";
    std::string camera = ReadText(folder() / name);
    WriteText(name, camera.replace(camera.find("3 0.05 41 5"), 11, "3 0.05"));
  };
  take_range(1);
  options_.output = output("one_without");
  Run(&fake_);
  EXPECT_FALSE(Has("depth/000001.pfm"));
  EXPECT_TRUE(Has("depth/000000.pfm"));
  EXPECT_THAT(log_.str(), HasSubstr("no map for image 00000001.png: no depth range"));
  for (const int image : {0, 2, 3}) take_range(image);
  options_.output = output();
  EXPECT_THAT(Error(), HasAll("no depth range", "--depth-min"));
  options_.depth_min = 3;
  options_.depth_max = 5;
  for (const char* schedule : {"offline", "online"}) {
    options_.schedule = schedule;
    options_.output = output(schedule);
    Run(&fake_);
    EXPECT_NEAR(ReadPfm(options_.output / "depth/000000.pfm")(4, 4), 4.0, 0.01);  // the fake matcher's middle
  }
  options_.depth_min = 0;
  EXPECT_THAT(Error(), HasSubstr("together"));
  options_.depth_max = 0;
  options_.output = output("none");
  EXPECT_THAT(Error(), HasAll("none of the 4 images gets a map", "--depth-min"));
}

TEST_F(ReconstructTest, BadOptionsAreNamed) {
  EXPECT_THAT(ErrorWith([](auto* o) { o->source_views = 33; }), HasSubstr("--source-views = 33"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->depth_min = o->depth_max = 2; }), HasSubstr("must be below"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->depth_max = 0.5; }),
              HasSubstr("depth range"));  // below the dataset's near end
  EXPECT_THAT(ErrorWith([](auto* o) { o->maps = {"normal", "normal"}; }), HasSubstr("normal is given more than once"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->maps = {"depth", "none"}; }), HasSubstr("none stands alone"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->maps = {"normal"}, o->dmb = true; }), HasSubstr("--dmb: needs depth"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->preset = "best"; }), HasSubstr("\"best\""));
  EXPECT_THAT(ErrorWith([](auto* o) { o->preset = "online", o->max_image_size = 1; }),
              HasAll(".png: is matched at 1 x 1 px", "must be at least 2 x 2"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->images = "2"; }), HasSubstr("3 of the scene's for it are not among --images"));
  EXPECT_THAT(ErrorWith([](auto* o) { o->mapper.window_size = 1; }), HasSubstr("--window-size = 1"));
  EXPECT_TRUE(fake_.calls.empty());
}

TEST_F(ReconstructTest, QuietRunsPrintNothing) {
  options_.quiet = true;
  Run(&fake_);
  EXPECT_EQ(out_.str() + log_.str(), "");
  for (const char* stage : {"photometric", "prior construction", "planar prior", "geometric", "kernels"}) {
    EXPECT_THAT(ReadText(options_.output / "summary.json"), HasSubstr(stage)) << "its time";
  }
}

TEST(OfflinePlan, ViewsThatHardlyShareLandmarksAreNotChosen) {
  const PinholeCamera camera = {100, 80, 100, 100, 49.5, 39.5};
  Scene scene;
  for (int i = 0; i < 6; ++i) {  // in a row, looking the same way
    SceneImage image;
    image.camera = camera;
    image.cam_from_world.translation().x() = -0.4 * i;
    scene.images.push_back(image);
  }
  // The last one stands behind a wall: it sees none of the points that the others do.
  for (int i = 0; i < 40; ++i) {
    scene.landmarks_in_world.emplace_back(0.1 * (i % 8), 0.1 * (i / 8), 4);
    for (int k = 0; k < 6; ++k) {
      if ((k == 5) == (i % 2 == 1)) scene.images[static_cast<size_t>(k)].landmark_indices.push_back(i);
    }
  }
  const auto plan_of = [&] {
    return MakePlan(scene, {0, 1, 2, 3, 4, 5}, {}, std::vector<std::optional<DepthRange>>(6, DepthRange{3, 5}));
  };
  const ReconstructPlan plan = plan_of();
  EXPECT_THAT(plan.images[0].sources, UnorderedElementsAre(1, 2, 3, 4));
  EXPECT_EQ(plan.images[5].sources.size(), 5u);  // none shares any with it: all are as good
  for (SceneImage& image : scene.images) image.landmark_indices.clear();
  EXPECT_THAT(plan_of().images[0].sources, UnorderedElementsAre(1, 2, 3, 4, 5));
}

TEST(Progress, TimeLeftIsThatOfTheStageAndIgnoresReusedSteps) {
  std::ostringstream stream;
  {
    Progress progress(&stream, &stream, false, true);
    progress.Begin("first", 10, 4);
    EXPECT_LT(progress.SecondsLeft(1), 0) << "reused steps say nothing about the speed";
    progress.Step();
    progress.Step();
    EXPECT_DOUBLE_EQ(progress.SecondsLeft(3), 3.0 / 2 * 4);
    progress.Begin("second", 10);
    for (int i = 0; i < 7; ++i) progress.Step();
    progress.Warn("look");
  }
  EXPECT_THAT(stream.str(), HasSubstr("[#####################.........] 70 %  second 7/10"));
  EXPECT_THAT(stream.str(), HasSubstr("\r\033[Kwarning: look\n"));
  EXPECT_EQ(FormatDuration(127) + " " + FormatDuration(3909.4), "2:07 1:05:09");
}

}  // namespace
}  // namespace acmp
