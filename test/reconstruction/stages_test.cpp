// Stages of chunks, by a process each or by one, end with the bytes of a run alone.

#include <atomic>
#include <fstream>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "reconstruction/run_fixture.h"
#include "support/error_text.h"
#include "work_files.h"

namespace acmp {
namespace {

using nlohmann::json;

class StagesTest : public ReconstructRunFixture {
 protected:
  static constexpr int kStreetImages = 9;

  /// Nine images, each matched against its two neighbours on either side; chunks of two.
  StagesTest() {
    WriteScene(kStreetImages, kWidth, kHeight);
    std::vector<std::vector<int>> sources(kStreetImages);
    for (int i = 0; i < kStreetImages; ++i) {
      for (int j = std::max(0, i - 2); j <= std::min(kStreetImages - 1, i + 2); ++j) {
        if (j != i) sources[static_cast<size_t>(i)].push_back(j);
      }
    }
    WritePairs(sources);
    options_.chunk_images = 2;
  }

  struct Task {
    std::string stage, images;
    std::vector<int> after;
  };

  json PlanFile() {
    options_.plan = folder() / "plan.json";
    Run(&fake_);
    options_.plan.clear();
    std::ifstream stream(folder() / "plan.json");
    return json::parse(stream);
  }
  std::vector<Task> Plan() {
    std::vector<Task> tasks;
    const json plan = PlanFile();
    for (const json& task : plan.at("tasks")) {
      tasks.push_back({task.at("stage"), task.at("images"), task.at("after").get<std::vector<int>>()});
    }
    return tasks;
  }

  void PlanAfresh() {
    options_.overwrite = true;
    Plan();
    options_.overwrite = false;
  }

  using ReconstructRunFixture::Stage;
  void Stage(const Task& task, FakeMatcher* matcher) { Stage(task.stage, task.images, matcher); }

  /// In the reverse of the plan's order as far as that is allowed.
  void DoAll(const std::vector<Task>& tasks, FakeMatcher* matcher) {
    for (std::set<int> done; done.size() < tasks.size();) {
      for (int i = static_cast<int>(tasks.size()) - 1; i >= 0; --i) {
        const Task& task = tasks[static_cast<size_t>(i)];
        bool ready = done.count(i) == 0;
        for (int other : task.after) ready = ready && done.count(other) > 0;
        if (!ready) continue;
        Stage(task, matcher);
        done.insert(i);
      }
    }
  }

  void ChangeImage1() {
    std::filesystem::copy_file(scene() / "images/00000000.png", scene() / "images/00000001.png",
                               std::filesystem::copy_options::overwrite_existing);
  }

  std::string StageError(const std::string& stage, const std::string& images) {
    return MessageOf<InvalidInputError>([&] { Stage(stage, images, &fake_); });
  }

  struct Line {
    std::string text;
    std::function<void()> before = [] {};  ///< is done when it is asked for
  };

  /// One process that is told these lines. Returns its answers.
  std::string DoLines(const std::vector<Line>& lines, const DeviceMaker& make_devices, bool all_done = true) {
    std::ostringstream answers;
    size_t number = 0;
    const auto next = [&]() -> std::optional<std::string> {
      if (number == lines.size()) return std::nullopt;
      lines[number].before();
      return lines[number++].text;
    };
    ReconstructOptions options = options_;
    options.stages = true;
    EXPECT_EQ(ReconstructStages(options, {make_devices, watcher_, answers, log_, false}, next), all_done);
    return answers.str();
  }
  std::string DoLines(const std::vector<Line>& lines, FakeMatcher* matcher, bool all_done = true) {
    devices_made_ = 0;
    const auto make_devices = [&] {
      ++devices_made_;
      return FakeHost(matcher);
    };
    return DoLines(lines, make_devices, all_done);
  }

  /// Of all tasks of a plan.
  std::vector<Line> PlannedLines() {
    std::vector<Line> lines;
    for (const Task& task : Plan()) {
      lines.push_back({task.stage == "finish" ? task.stage : task.stage + " " + task.images});
    }
    return lines;
  }

  static std::vector<uint32_t> Results(const FakeMatcher& matcher) {
    std::vector<uint32_t> hashes;
    for (const FakeMatcher::Call& call : matcher.calls) hashes.push_back(call.result_hash);
    return hashes;
  }

  int devices_made_ = 0;
};

TEST_F(StagesTest, EndWithTheBytesOfARunAloneAndRepeatNothing) {
  const int passes = RunTo("alone");
  const std::vector<Task> tasks = Plan();
  FakeMatcher matcher;
  DoAll(tasks, &matcher);
  EXPECT_EQ(static_cast<int>(matcher.calls.size()), passes);
  ExpectSameContents(output("alone"), output());
  EXPECT_EQ(PlanFile(), json({{"complete", true}, {"tasks", json::array()}}));
  FakeMatcher none;
  Stage("step_0", "0-1", &none);
  Run(&none);
  EXPECT_THAT(out_.str(), HasSubstr("already complete"));
  EXPECT_TRUE(none.calls.empty());
}

TEST_F(StagesTest, WriteTheCloudOfARunAloneAlsoFarFromTheOrigin) {
  offset_ = {500000, 5500000, 200};
  WriteScene(kImages, kWidth, kHeight);
  RunTo("alone");
  FakeMatcher matcher;
  for (const Task& task : Plan()) {
    if (task.stage == "finish") WriteText("out/fused.ply.acmp.partial", "cut");  // of one that was killed there
    Stage(task, &matcher);
  }
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, WaitForJustWhatTheyRead) {
  const std::vector<Task> tasks = Plan();
  const auto find = [&](const std::string& stage, const std::string& images) {
    const auto found = std::find_if(tasks.begin(), tasks.end(),
                                    [&](const Task& task) { return task.stage == stage && task.images == images; });
    EXPECT_TRUE(found != tasks.end()) << stage << " " << images;
    return static_cast<int>(found - tasks.begin());
  };
  const auto after = [&](const std::string& stage, const std::string& images) {
    const std::vector<int>& numbers = tasks.at(static_cast<size_t>(find(stage, images))).after;
    return std::set<int>(numbers.begin(), numbers.end());
  };
  EXPECT_TRUE(after("step_0", "4-5").empty());
  EXPECT_EQ(after("step_1", "4-5"), (std::set{find("step_0", "2-3"), find("step_0", "4-5"), find("step_0", "6-7")}));
  EXPECT_EQ(after("maps", "0-1"), (std::set{find("final", "0-1"), find("final", "2-3")}));
  EXPECT_EQ(tasks.back().stage, "finish");
  EXPECT_EQ(tasks.back().after.size(), 5u);
}

TEST_F(StagesTest, InterruptedOrDoneTwiceAnywhereEndWithTheSameBytes) {
  RunTo("alone");
  for (const Task& task : Plan()) {
    FakeMatcher first, second, third;
    StopRequest watcher;
    first.on_call = [&](int call) {
      if (call == 1) watcher.Request();
    };
    try {
      Stage(task.stage, task.images, &first, &watcher);
      EXPECT_LE(first.calls.size(), 1u);
    } catch (const Interrupted&) {
    }
    Stage(task, &second);
    Stage(task, &third);
    EXPECT_TRUE(third.calls.empty()) << task.stage << " " << task.images;
  }
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, MakeWhatIsMissingOrDamagedThemselves) {
  RunTo("alone");
  const std::vector<Task> tasks = Plan();
  FakeMatcher matcher;
  Stage("maps", "4-5", &matcher);  // none of the stages before
  EXPECT_FALSE(matcher.calls.empty());
  for (const Task& task : tasks) {
    if (task.stage != "maps" && task.stage != "finish") Stage(task, &matcher);
  }
  std::string damaged = ReadText(output() / "work/final/000003.bin");
  damaged[damaged.size() / 2] ^= 1;
  WriteText("out/work/final/000003.bin", damaged);
  Stage("maps", "2-3", &matcher);
  EXPECT_THAT(log_.str(), HasSubstr("000003.bin is damaged: its step of image 00000003.png is computed again"));
  std::string of_the_same_size = ReadText(output() / "depth/000002.pfm");
  of_the_same_size[of_the_same_size.size() / 2] ^= 1;
  WriteText("out/depth/000002.pfm", of_the_same_size);
  WriteText("out/depth/000003.pfm", "cut");
  std::filesystem::remove(output() / "work/final/000007.bin");
  Stage("finish", "", &matcher);  // without most of the stage before
  ExpectSameContents(output("alone"), output());
}

TEST_F(StagesTest, RefuseWhatIsNotPlannedOrHasChanged) {
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("out: has no plan: give --plan first"));
  EXPECT_FALSE(std::filesystem::exists(output()));
  RunInterrupted(5);
  options_.plan = folder() / "plan.json";
  EXPECT_THAT(Error(), HasSubstr("holds an interrupted run of one process"));
  options_.plan.clear();
  PlanAfresh();
  EXPECT_THAT(StageError("step_9", "0"), HasSubstr("stage step_9: must be one of step_0, "));
  EXPECT_THAT(StageError("step_0", ""), HasSubstr("must be STAGE IMAGES"));
  EXPECT_THAT(StageError("step_0", "77"), HasSubstr("[0, 8]"));
  options_.seed = 7;
  EXPECT_THAT(StageError("step_0", "0"), HasSubstr("seed was 1 and is 7"));
  options_.seed = 1;
  EXPECT_THAT(Error(), HasSubstr("holds a run with other settings"));
  Stage("step_0", "0-1", &fake_);
  const std::string plan = *ReadWorkFile(output() / "work/plan/000000.bin");
  WriteWorkFile(output() / "work/plan/000000.bin", "{}");
  EXPECT_THAT(StageError("step_1", "0-1"), HasSubstr("its plan is of another version"));
  WriteWorkFile(output() / "work/plan/000000.bin", plan);
  ChangeImage1();
  EXPECT_THAT(StageError("step_1", "0-1"), HasSubstr("00000001.png: it, its mask or its prior depth has changed"));
}

class NamedEngine final : public FakeMatcherEngine {
 public:
  NamedEngine(std::string name, FakeMatcher* matcher) : FakeMatcherEngine(matcher), name_(std::move(name)) {}
  std::string device_name() const override { return name_; }

 private:
  std::string name_;
};

TEST_F(StagesTest, OfTwoModelsOfDevicesThatBeginAtOnceOneIsRefusedBeforeItComputes) {
  const std::vector<std::pair<std::string, std::string>> models = {{"model A (0)", "0-1"}, {"model B (0)", "2-3"}};
  for (int round = 0; round < 20; ++round) {  // neither is always the first
    options_.output = output("round_" + std::to_string(round));
    Plan();
    std::atomic<size_t> waiting = 0;
    std::vector<FakeMatcher> matchers(models.size());
    std::vector<std::future<std::string>> errors;
    for (size_t i = 0; i < models.size(); ++i) {
      errors.push_back(std::async(std::launch::async, [&, i, options = options_]() mutable -> std::string {
        options.stages = true;
        std::optional<std::string> line = "step_0 " + models[i].second;
        const auto make_devices = [&] {
          std::vector<ReconstructDevice> devices(1);
          devices[0].engines.push_back(std::make_unique<NamedEngine>(models[i].first, &matchers[i]));
          devices[0].on_host = true;
          for (++waiting; waiting < models.size();) std::this_thread::yield();
          return devices;
        };
        StopRequest stop;
        std::ostringstream out, log;
        const auto next = [&] { return std::exchange(line, std::nullopt); };
        return ReconstructStages(options, {make_devices, stop, out, log, false}, next) ? "" : out.str();
      }));
    }
    std::vector<std::string> told;
    for (std::future<std::string>& error : errors) told.push_back(error.get());
    const size_t refused = told[0].empty() ? 1 : 0;
    EXPECT_THAT(told[refused], HasSubstr("--device")) << "round " << round;
    EXPECT_EQ(told[1 - refused], "") << "round " << round;
    EXPECT_TRUE(matchers[refused].calls.empty() && !matchers[1 - refused].calls.empty()) << "round " << round;
  }
}

TEST_F(StagesTest, OptionsThatDoNotGoTogether) {
  EXPECT_EQ(ErrorWith([](auto* o) { o->plan = "p", o->stages = true; }), "--stages: not with --plan");
  EXPECT_THAT(ErrorWith([](auto* o) { o->stages = true, o->images = "0"; }), HasSubstr("--stages: not with --images"));
  EXPECT_EQ(ErrorWith([](auto* o) { o->plan = "p", o->schedule = "online"; }), "--plan: not with --schedule online");
  EXPECT_EQ(ErrorWith([](auto* o) { o->plan = "p", o->colmap = true; }), "--plan: not with --colmap");
}

TEST_F(StagesTest, OfOneProcessAreTheSameAlsoOnGpusAndLeaveNoEstimatesThere) {
  const int passes = RunTo("alone");
  FakeMatcher matcher;
  DoLines(PlannedLines(), &matcher);
  EXPECT_EQ(devices_made_, 1);
  EXPECT_EQ(static_cast<int>(matcher.calls.size()), passes);
  ExpectSameContents(output("alone"), output());
  for (const int devices : {1, 2}) {
    options_.output = output("gpus_" + std::to_string(devices));
    FakeGpuBehaviour gpu;
    std::vector<Line> lines = PlannedLines();
    for (Line& line : lines) {
      line.before = [&] { EXPECT_EQ(gpu.NumEstimatesAlive(), 0u); };
    }
    DoLines(lines, [&] { return FakeGpus(devices, 2, &gpu); });
    EXPECT_FALSE(gpu.estimates.empty());
    ExpectSameContents(output("alone"), options_.output);
  }
}

TEST_F(StagesTest, OfOneProcessGoOnAfterAFailure) {
  Plan();
  FakeMatcher matcher;
  matcher.on_call = [fails = true](int) mutable {
    if (std::exchange(fails, false)) throw ProcessingError("the device\nis lost");
  };
  const std::string answers =
      DoLines({{"step_9 0-1"}, {""}, {"step_0 0 1"}, {"step_0"}, {"step_0 77"}, {"step_0 0-1"}, {"step_0 0-1"}},
              &matcher, false);
  std::istringstream stream(answers);
  for (const char* expected :
       {"step_9 0-1: exit code 2: stage step_9: ", ": exit code 2: --stages: line \"\": must be STAGE IMAGES",
        "step_0 0 1: exit code 2: --stages: line \"step_0 0 1\": ", "step_0: exit code 2: stage without images",
        "step_0 77: exit code 2: image list: \"77\": ", "step_0 0-1: exit code 1: the device is lost",
        "step_0 0-1: done"}) {
    std::string line;
    EXPECT_TRUE(std::getline(stream, line));
    EXPECT_THAT(line, StartsWith(expected));
  }
  EXPECT_EQ(devices_made_, 2) << "a device that has failed is not used again";
}

TEST_F(StagesTest, OfOneProcessFollowImagesAndPlansThatChange) {
  Plan();
  FakeMatcher matcher, other;
  DoLines({{"step_0 2-3"},  // which reads image 1
           {"step_0 0-1",
            [&] {
              ChangeImage1();
              PlanAfresh();
              matcher.calls.clear();
            }}},
          &matcher);
  PlanAfresh();
  Stage("step_0", "0-1", &other);
  EXPECT_EQ(Results(matcher), Results(other));
}

}  // namespace
}  // namespace acmp
