#include "progress.h"
#include <gmock/gmock.h>

#include <sstream>
#include <string>

namespace acmp {
namespace {

using ::testing::HasSubstr;

TEST(Progress, TimeLeftFollowsTheShareOfTheWorkAndIgnoresReusedSteps) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kSilent);
  EXPECT_LT(progress.SecondsLeft(1), 0);
  progress.Begin("first", 4, 0.4);
  progress.Step(true);
  progress.Step(true);
  EXPECT_LT(progress.SecondsLeft(1), 0) << "reused steps say nothing about the speed";
  progress.Step();
  progress.Step();
  EXPECT_DOUBLE_EQ(progress.done_share(), 0.4);
  EXPECT_NEAR(progress.SecondsLeft(3), 3.0 / 2 * 6, 1e-9);
  progress.Begin("second", 2);
  progress.Step();
  EXPECT_DOUBLE_EQ(progress.done_share(), 0.7);
  progress.Step();
  EXPECT_DOUBLE_EQ(progress.done_share(), 1);
  progress.Note("hello");
  progress.Warn("look");
  EXPECT_EQ(stream.str(), "warning: look\n");
}

TEST(Progress, BarIsErasedForMessagesAndAtTheEnd) {
  std::ostringstream stream;
  {
    Progress progress(&stream, ProgressStyle::kBar);
    progress.Begin("stage", 2);
    progress.Step();
    progress.Warn("look");
  }
  EXPECT_THAT(stream.str(), HasSubstr("[###############...............] 50 %  stage 1/2"));
  EXPECT_THAT(stream.str(), HasSubstr("\r\033[Kwarning: look\n"));
}

TEST(FormatDuration, UsesHoursOnlyWhenNeeded) {
  EXPECT_EQ(FormatDuration(3.6), "0:04");
  EXPECT_EQ(FormatDuration(127), "2:07");
  EXPECT_EQ(FormatDuration(3909), "1:05:09");
  EXPECT_EQ(FormatDuration(-5), "0:00");
}

}  // namespace
}  // namespace acmp
