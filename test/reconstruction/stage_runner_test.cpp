// Stages that one process does one after the other: acmp_reconstruct --stages.

#include <gmock/gmock.h>

#include <functional>
#include <optional>
#include <sstream>
#include <utility>

#include "reconstruction/fake_gpu.h"
#include "reconstruction/stages_fixture.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class StageRunnerTest : public StagesFixture {
 protected:
  struct Line {
    std::string text;
    std::function<void()> before = [] {};  ///< is done when it is asked for
  };

  /// One process that is told these lines. Returns its answers.
  std::string DoLines(const std::vector<Line>& lines, const DeviceMaker& make_devices, bool all_done = true) {
    options_.stages = true;
    std::ostringstream answers;
    size_t number = 0;
    const auto next = [&]() -> std::optional<std::string> {
      if (number == lines.size()) return std::nullopt;
      options_.stages = false;
      lines[number].before();
      return lines[number++].text;
    };
    EXPECT_EQ(ReconstructStages(options_, make_devices, &watcher_, next, &answers, &log_, false), all_done);
    options_.stages = false;
    return answers.str();
  }

  std::string DoLines(const std::vector<Line>& lines, FakeMatcher* matcher, bool all_done = true) {
    devices_made_ = 0;
    const auto make_devices = [&] {
      ++devices_made_;
      return DevicesOf(matcher);
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

TEST_F(StageRunnerTest, EndsWithTheBytesOfARunAlone) {
  const int passes = RunAlone();
  const std::vector<Line> lines = PlannedLines();
  std::string answers;
  for (const Line& line : lines) answers += line.text + ": done\n";
  options_.quiet = true;
  FakeMatcher matcher;
  EXPECT_EQ(DoLines(lines, &matcher), answers);
  EXPECT_EQ(devices_made_, 1);
  EXPECT_EQ(static_cast<int>(matcher.calls.size()), passes);
  ExpectSameContents(output("alone"), output());
}

TEST_F(StageRunnerTest, KeepsNoEstimatesOnAGpu) {
  RunAlone();
  FakeGpuBehaviour gpu;
  std::vector<Line> lines = PlannedLines();
  for (Line& line : lines) {
    line.before = [&] { EXPECT_EQ(gpu.NumEstimatesAlive(), 0u); };
  }
  const auto make_gpu = [&] {
    std::vector<ReconstructDevice> devices(1);
    devices[0].engines.push_back(std::make_unique<FakeGpu>(0, &gpu));
    return devices;
  };
  DoLines(lines, make_gpu);
  EXPECT_FALSE(gpu.estimates.empty());
  ExpectSameContents(output("alone"), output());
}

TEST_F(StageRunnerTest, AnswersAFailureAndGoesOn) {
  Plan();
  FakeMatcher matcher;
  matcher.on_call = [fails = true](int) mutable {
    if (std::exchange(fails, false)) throw ProcessingError("the device\nis lost");
  };
  const std::string answers = DoLines(
      {{"step_9 0-1"}, {""}, {"step_0 0 1"}, {"step_0"}, {"step_0 77"}, {"step_0 0-1"}, {"step_0 0-1"}, {"finish"}},
      &matcher, false);
  std::istringstream stream(answers);
  for (const char* expected :
       {"step_9 0-1: exit code 2: --stage step_9: must be one of step_0, ",
        ": exit code 2: --stages: line \"\": must be STAGE IMAGES, as step_0 0-15, or finish",
        "step_0 0 1: exit code 2: --stages: line \"step_0 0 1\": must be STAGE IMAGES",
        "step_0: exit code 2: --stage: needs --images", "step_0 77: exit code 2: image list: \"77\": must be",
        "step_0 0-1: exit code 1: the device is lost", "step_0 0-1: done",
        "finish: exit code 1: --stage finish: stage step_0 of image 00000002.png (index 2) is not done"}) {
    std::string line;
    EXPECT_TRUE(std::getline(stream, line));
    EXPECT_THAT(line, StartsWith(expected));
  }
  EXPECT_EQ(devices_made_, 2) << "a device that has failed is not used again";
}

TEST_F(StageRunnerTest, ReadsAnImageThatHasChangedAgain) {
  Plan();
  FakeMatcher matcher, other;
  const std::string answers = DoLines({{"step_0 2-3"},  // which reads image 1
                                       {"step_0 0-1",
                                        [&] {
                                          ChangeImage1();
                                          matcher.calls.clear();
                                        }}},
                                      &matcher);
  EXPECT_EQ(answers, "step_0 2-3: done\nstep_0 0-1: done\n");
  options_.overwrite = true;
  Plan();
  options_.overwrite = false;
  Stage("step_0", "0-1", &other);
  EXPECT_EQ(Results(matcher), Results(other));
}

TEST_F(StageRunnerTest, FollowsAPlanThatIsMadeAfresh) {
  Plan();
  const auto plan_less = [&] {
    options_.images = "0-6";
    options_.overwrite = true;
    PlanFile();
    options_.images.clear();
    options_.overwrite = false;
  };
  FakeMatcher matcher, other;
  DoLines({{"step_0 6-7"},  // both match image 8
           {"step_0 6",
            [&] {
              plan_less();
              matcher.calls.clear();
            }}},
          &matcher);
  plan_less();
  Stage("step_0", "6", &other);
  EXPECT_EQ(Results(matcher), Results(other));
}

}  // namespace
}  // namespace acmp
