#include "acmp_mapping/intake/stream_buffers.h"

#include <gtest/gtest.h>

#include "intake/samples.h"

namespace acmp {
namespace {

TEST(TimeJumpTracker, NeedNotJumpWhereItHadNotGotSoFar) {
  TimeJumpTracker runs;
  runs.Add(10 * kS, 1);
  EXPECT_EQ(runs.StartRun(10 * kS - kTimeJumpNs), std::nullopt);
  EXPECT_FALSE(runs.is_behind());
  EXPECT_FALSE(runs.Add(11 * kS, 2));
  EXPECT_FALSE(runs.Add(0, 3)) << "not what the images' jump was about";
  EXPECT_EQ(runs.StartRun(0), 3u) << "but the next one";
}

TEST(TimeJumpTracker, TakesAJumpLongAfterTheImagesForTheirs) {
  TimeJumpTracker runs;
  runs.Add(10 * kS, 1);
  runs.StartRun(0);
  runs.Add(3 * kS, 2);  // the images are there by now; the run ends before 10 s
  runs.Add(4 * kS, 3);
  EXPECT_EQ(runs.StartRun(0), std::nullopt) << "nothing of the third run has come";
  EXPECT_TRUE(runs.is_behind());
}

TEST(TimeJumpTracker, TakesWrongOrderForNoJump) {
  TimeJumpTracker runs;
  runs.Add(10 * kS, 1);
  runs.Add(10 * kS - kTimeJumpNs, 2);
  EXPECT_EQ(runs.newest_ns(), 10 * kS);
  EXPECT_EQ(runs.StartRun(0), std::nullopt);
}

TEST(TimeJumpTracker, ForgetsAJumpThatWasUndone) {
  TimeJumpTracker runs;
  runs.Add(10 * kS, 1);
  runs.Add(3 * kS, 2);  // an old pose sent again
  runs.Add(11 * kS, 3);
  EXPECT_EQ(runs.StartRun(0), std::nullopt) << "all of it is of the run before";
}

}  // namespace
}  // namespace acmp
