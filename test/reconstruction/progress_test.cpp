#include "progress.h"
#include <gmock/gmock.h>

#include <sstream>

namespace acmp {
namespace {

using ::testing::HasSubstr;

TEST(Progress, TimeLeftFollowsTheShareOfTheWorkAndIgnoresReusedSteps) {
  std::ostringstream stream;
  {
    Progress progress(&stream, ProgressStyle::kBar);
    progress.Begin("first", 4, 0.4);
    progress.Step(true);
    progress.Step(true);
    EXPECT_LT(progress.SecondsLeft(1), 0) << "reused steps say nothing about the speed";
    progress.Step();
    progress.Step();
    EXPECT_NEAR(progress.SecondsLeft(3), 3.0 / 2 * 6, 1e-9);
    progress.Begin("second", 2);
    progress.Step();
    EXPECT_DOUBLE_EQ(progress.done_share(), 0.7);
    progress.Warn("look");
  }
  EXPECT_THAT(stream.str(), HasSubstr("[#####################.........] 70 %  second 1/2"));
  EXPECT_THAT(stream.str(), HasSubstr("\r\033[Kwarning: look\n"));
  EXPECT_EQ(FormatDuration(127) + " " + FormatDuration(3909.4), "2:07 1:05:09");
}

}  // namespace
}  // namespace acmp
