// Stages of chunks, one process each, end with the bytes of a run alone.

#include <gmock/gmock.h>

#include "acmp_mapping/dataset/map_io.h"
#include "reconstruction/stages_fixture.h"

namespace acmp {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using StagesTest = StagesFixture;

TEST_F(StagesTest, EndWithTheBytesOfARunAloneAndRepeatNothing) {
  const int passes = RunAlone();
  const std::vector<Task> tasks = Plan();
  FakeMatcher matcher;
  DoAll(tasks, {}, &matcher);
  EXPECT_EQ(static_cast<int>(matcher.calls.size()), passes);
  ExpectSameContents(output("alone"), output());
  EXPECT_EQ(PlanFile(), json({{"complete", true}, {"tasks", json::array()}}));
  FakeMatcher none;
  Stage("step_0", "0-1", &none);
  Run(&none);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
  EXPECT_TRUE(none.calls.empty());
}

TEST_F(StagesTest, OfOneImageOrSeveralChunksAtOnceMakeTheSame) {
  RunAlone();
  Plan();
  for (const char* stage : {"step_0", "step_1", "step_2", "step_3", "final"}) {
    if (!std::filesystem::exists(output() / "work" / stage) && std::string(stage) == "step_3") continue;
    for (const char* images : {"5-8", "0", "1,3", "2-4"}) Stage(stage, images, &fake_);
  }
  Stage("maps", "0-8", &fake_);
  Stage("fuse", "0-5", &fake_);
  Stage("fuse", "6-8", &fake_);
  Stage("finish", "", &fake_);
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, WriteTheTilesOfARunAlone) {
  options_.tile_size = 0.5;
  RunAlone();
  ASSERT_TRUE(std::filesystem::exists(output("alone") / "tiles/index.json"));
  const std::vector<Task> tasks = Plan();
  options_.memory_limit_gb = 0;  // all points go through the work file
  FakeMatcher matcher;
  for (const Task& task : tasks) {
    if (task.stage == "finish") {  // a process that is killed there leaves this
      WriteText("out/tiles/0_0_8.ply.partial", "cut");
      WriteText("out/work/tiles/000000.bin.partial", "cut");
    }
    Stage(task, &matcher);
  }
  EXPECT_THAT(out_.str(), HasSubstr(" tiles; took "));
  std::filesystem::remove(output() / "tiles/0_0_8.ply.partial");
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, FarFromTheOriginTheyMakeTheSame) {
  offset_ = {500000, 5500000, 200};
  WriteScene(kImages, kWidth, kHeight);
  RunAlone();
  FakeMatcher matcher;
  DoAll(Plan(), {}, &matcher);
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, OfAnotherTileSizeAreRefused) {
  options_.tile_size = 0.5;
  Plan();
  options_.tile_size = 0.25;
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("tile-size was 0.5 and is 0.25"));
  options_.tile_size.reset();
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("tile-size was 0.5 and is none"));
}

TEST_F(StagesTest, WaitForJustWhatTheyRead) {
  const std::vector<Task> tasks = Plan();
  const auto find = [&](const std::string& stage, const std::string& images) {
    for (size_t i = 0; i < tasks.size(); ++i) {
      if (tasks[i].stage == stage && tasks[i].images == images) return static_cast<int>(i);
    }
    ADD_FAILURE() << stage << " " << images;
    return 0;
  };
  const auto after = [&](const std::string& stage, const std::string& images) {
    const std::vector<int>& numbers = tasks[static_cast<size_t>(find(stage, images))].after;
    return std::set<int>(numbers.begin(), numbers.end());
  };
  EXPECT_TRUE(after("step_0", "4-5").empty());
  EXPECT_EQ(after("step_1", "4-5"), (std::set{find("step_0", "2-3"), find("step_0", "4-5"), find("step_0", "6-7")}));
  EXPECT_EQ(after("maps", "0-1"), (std::set{find("final", "0-1"), find("final", "2-3")}));
  EXPECT_EQ(after("fuse", "0-1"), after("maps", "0-1"));
  EXPECT_EQ(after("fuse", "8-8"), (std::set{find("final", "6-7"), find("final", "8-8"), find("fuse", "6-7")}))
      << "which has taken over what 4-5 has used";
  EXPECT_EQ(tasks.back().stage, "finish");
  EXPECT_EQ(tasks.back().after.size(), 10u);
}

TEST_F(StagesTest, InterruptedOrDoneTwiceAnywhereEndWithTheSameBytes) {
  RunAlone();
  const std::vector<Task> tasks = Plan();
  std::set<int> done;
  for (size_t i = 0; i < tasks.size(); ++i) {
    FakeMatcher first, second, third;
    StopRequest watcher;
    first.on_call = [&](int call) {
      if (call == 1) watcher.Request();
    };
    try {
      Stage(tasks[i].stage, tasks[i].images, &first, &watcher);
      EXPECT_LE(first.calls.size(), 1u);
    } catch (const Interrupted&) {
    }
    Stage(tasks[i], &second);
    Stage(tasks[i], &third);
    EXPECT_TRUE(third.calls.empty()) << tasks[i].stage << " " << tasks[i].images;
  }
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, MakeWhatIsMissingOrDamagedThemselves) {
  RunAlone();
  const std::vector<Task> tasks = Plan();
  FakeMatcher matcher;
  Stage("maps", "4-5", &matcher);  // none of the stages before
  EXPECT_FALSE(matcher.calls.empty());
  for (const Task& task : tasks) {
    if (task.stage != "maps" && task.stage != "fuse" && task.stage != "finish") Stage(task, &matcher);
  }
  std::string damaged = ReadText(output() / "work/final/000003.bin");
  damaged[damaged.size() / 2] ^= 1;
  WriteText("out/work/final/000003.bin", damaged);
  Stage("maps", "2-3", &matcher);
  EXPECT_THAT(log_.str(), HasSubstr("000003.bin is damaged: its step of image 00000003.png is computed again"));
  WriteText("out/depth/000003.pfm", "cut");
  DoAll(tasks, {}, &matcher);
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, RefuseWhatIsNotPlanned) {
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("out: has no plan: give --plan first"));
  EXPECT_FALSE(std::filesystem::exists(output()));
  Plan();
  EXPECT_THAT(StageError("step_9", "0"), HasSubstr("--stage step_9: must be one of step_0, "));
  EXPECT_THAT(StageError("step_0", ""), HasSubstr("--stage: needs --images"));
  EXPECT_THAT(StageError("step_0", "77"), HasSubstr("image list: \"77\": must be an index in [0, 9]"));
  EXPECT_THAT(StageError("step_0", "9"), HasSubstr("--images 9: the plan has none of these images"));
  EXPECT_THAT(StageError("fuse", "1-3"), HasSubstr("must have whole chunks of 2 images, and --images 1-3 lacks 0"));
  options_.seed = 7;
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("seed was 1 and is 7"));
  options_.seed = 1;
  options_.chunk_images = 3;
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("--chunk-images 3: the plan in " + output().string() + " has 2"));
  options_.chunk_images = 2;
  EXPECT_THAT(MessageOf<ProcessingError>([&] { Stage("finish", "", &fake_); }),
              HasSubstr("stage step_0 of image 00000000.png (index 0) is not done"));
  EXPECT_THAT(MessageOf<ProcessingError>([&] { Stage("fuse", "4-5", &fake_); }),
              HasSubstr("the stage of the images from 2 on is not done"));
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("holds a run with other settings"));
}

TEST_F(StagesTest, RefuseAnImageThatHasChanged) {
  Plan();
  Stage("step_0", "0-1", &fake_);
  ChangeImage1();
  EXPECT_THAT(StageError("step_1", "0-1"),
              HasSubstr("image 00000001.png: it, its mask or its prior depth has changed"));
}

TEST_F(StagesTest, ReadPriorDepth) {
  const std::filesystem::path depths = folder() / "depths";
  std::filesystem::create_directories(depths);
  for (int i = 0; i < kStreetImages; ++i)
    WritePfm(depths / ("0000000" + std::to_string(i) + ".pfm"), DepthMap(5, 4, 2));
  options_.prior_depth = depths;
  RunAlone();
  std::string logs;
  for (const Task& task : Plan()) {
    Stage(task, &fake_);
    logs += log_.str();
  }
  EXPECT_THAT(logs, HasSubstr("the prior depth of 2 images is not used, for example of 00000000.png: "));
  ExpectSameContents(output("alone"), output());
  options_.plan = folder() / "plan.json";
  WritePfm(depths / "00000001.pfm", DepthMap(5, 4, 3));
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("prior depth"));
}

TEST_F(StagesTest, AnotherSceneIsRefusedUntilOverwrite) {
  Plan();
  options_.images = "0-6";
  options_.plan = folder() / "plan.json";
  EXPECT_THAT(ErrorOf(&fake_), HasSubstr("holds a run with other settings (input (hash"));
  options_.overwrite = true;
  Run(&fake_);
  options_.overwrite = false;
  options_.images.clear();
  options_.plan.clear();
  EXPECT_THAT(StageError("step_0", "8"), HasSubstr("image list: \"8\""));
}

TEST_F(StagesTest, OptionsThatDoNotGoTogether) {
  const auto error = [&] { return ErrorOf(&fake_); };
  options_.stage = "maps";
  options_.plan = folder() / "plan.json";
  EXPECT_EQ(error(), "--plan: not with --stage");
  options_.stages = true;
  EXPECT_EQ(error(), "--plan: not with --stages");
  options_.plan.clear();
  EXPECT_EQ(error(), "--stages: not with --stage");
  options_.stage.clear();
  options_.images = "0";
  EXPECT_EQ(error(), "--stages: not with --images: its lines name them");
  options_.images.clear();
  options_.stages = false;
  options_.plan = folder() / "plan.json";
  options_.schedule = "online";
  EXPECT_EQ(error(), "--plan: not with --schedule online");
  options_.schedule = "offline";
  options_.colmap = true;
  EXPECT_EQ(error(), "--plan: not with --colmap");
  options_.colmap = false;
  options_.chunk_images = 0;
  EXPECT_THAT(error(), HasSubstr("--chunk-images = 0"));
}

}  // namespace
}  // namespace acmp
