#include "acmp_mapping/intake/time_jump_tracker.h"

#include <gtest/gtest.h>

#include "intake/samples.h"

namespace acmp {
namespace {

TEST(TimeJumpTracker, KnowsTheNewRunByItsOwnJump) {
  TimeJumpTracker runs;
  EXPECT_FALSE(runs.Add(9 * kS, 1));
  EXPECT_FALSE(runs.Add(10 * kS, 2));
  EXPECT_FALSE(runs.Add(0, 3)) << "the images are still in the old run, which needs what it has";
  EXPECT_FALSE(runs.Add(kS, 4));
  EXPECT_EQ(runs.newest_ns(), kS);
  EXPECT_EQ(runs.StartRun(0), 3u);
  EXPECT_FALSE(runs.is_behind());
  EXPECT_EQ(runs.newest_ns(), kS) << "of the new run, which had begun";
}

TEST(TimeJumpTracker, IsBehindUntilItJumpsItself) {
  TimeJumpTracker runs;
  runs.Add(10 * kS, 1);
  EXPECT_EQ(runs.StartRun(0), std::nullopt);
  EXPECT_TRUE(runs.is_behind());
  EXPECT_EQ(runs.newest_ns(), INT64_MIN);
  EXPECT_FALSE(runs.Add(11 * kS, 2)) << "may be of the old run; only the next one tells";
  EXPECT_TRUE(runs.is_behind());
  EXPECT_TRUE(runs.Add(0, 3)) << "that one was of the old run";
  EXPECT_FALSE(runs.is_behind());
  EXPECT_EQ(runs.newest_ns(), 0);
  EXPECT_EQ(runs.StartRun(0), std::nullopt) << "the images' next jump is another one";
}

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

TEST(TimeJumpTracker, KnowsANewRunThatHasComeAsFarAsTheOldOne) {
  TimeJumpTracker runs;
  runs.Add(kS, 1);
  runs.Add(2 * kS, 2);
  runs.Add(kS, 3);
  runs.Add(2 * kS, 4);
  EXPECT_EQ(runs.StartRun(kS), 3u) << "a short bag that loops: all of it came before the first image";
  EXPECT_FALSE(runs.is_behind());
}

TEST(TimeJumpTracker, KnowsNothingOfAStreamWithoutMessages) {
  TimeJumpTracker runs;
  EXPECT_EQ(runs.StartRun(0), std::nullopt);
  EXPECT_FALSE(runs.is_behind());
  EXPECT_FALSE(runs.Add(0, 1));
}

}  // namespace
}  // namespace acmp
