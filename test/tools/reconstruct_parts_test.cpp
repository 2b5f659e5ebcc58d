#include <gmock/gmock.h>

#include <sstream>

#include "reconstruct_lru_cache.h"
#include "reconstruct_progress.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

class LruCacheTest : public ::testing::Test {
 protected:
  int Get(int key) {
    return *cache_.Get(
        key,
        [&] {
          ++made_;
          return std::make_shared<const int>(10 * key);
        },
        [](int) { return size_t{4}; });
  }
  LruCache<int, int> cache_{8};
  int made_ = 0;
};

TEST_F(LruCacheTest, KeepsWhatWasUsedLast) {
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(Get(2), 20);
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(made_, 2);
  EXPECT_EQ(Get(3), 30);  // drops 2
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(made_, 3);
  EXPECT_EQ(Get(2), 20);
  EXPECT_EQ(made_, 4);
  EXPECT_EQ(cache_.bytes(), 8u);
}

TEST_F(LruCacheTest, TooLargeValuesAreHandedOutButNotKept) {
  LruCache<int, int> tiny(3);
  const auto value = tiny.Get(
      1, [] { return std::make_shared<const int>(5); }, [](int) { return size_t{4}; });
  EXPECT_EQ(*value, 5);
  EXPECT_EQ(tiny.size(), 0u);
  EXPECT_EQ(tiny.bytes(), 0u);
}

TEST(Progress, TimeLeftFollowsTheCostAndIgnoresReusedSteps) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kSilent, 10.0);
  EXPECT_LT(progress.SecondsLeft(1), 0);
  progress.Begin("first", 4, 1.0);
  progress.Step(true);
  progress.Step(true);
  EXPECT_LT(progress.SecondsLeft(1), 0) << "reused steps say nothing about the speed";
  progress.Step();
  progress.Step();
  EXPECT_DOUBLE_EQ(progress.done_share(), 0.4);
  EXPECT_DOUBLE_EQ(progress.SecondsLeft(3), 3.0 / 2 * 6);
  EXPECT_EQ(stream.str(), "");
}

TEST(Progress, LinesOncePerPercent) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kLines, 1000.0);
  progress.Begin("many", 1000, 1.0);
  for (int i = 0; i < 1000; ++i) progress.Step();
  const std::string text = stream.str();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 101);
  EXPECT_THAT(text, HasSubstr("100 %  many 1000/1000"));
}

TEST(Progress, BarIsErasedForMessagesAndAtTheEnd) {
  std::ostringstream stream;
  {
    Progress progress(&stream, ProgressStyle::kBar, 2.0);
    progress.Begin("stage", 2, 1.0);
    progress.Step();
    progress.Warn("look");
  }
  EXPECT_THAT(stream.str(), HasSubstr("[###############...............] 50 %  stage 1/2"));
  EXPECT_THAT(stream.str(), HasSubstr("\r\033[Kwarning: look\n"));
}

TEST(Progress, SilentStyleStillWarns) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kSilent, 2.0);
  progress.Note("hello");
  progress.Warn("look");
  EXPECT_EQ(stream.str(), "warning: look\n");
}

TEST(FormatDuration, UsesHoursOnlyWhenNeeded) {
  EXPECT_EQ(FormatDuration(3.6), "0:04");
  EXPECT_EQ(FormatDuration(127), "2:07");
  EXPECT_EQ(FormatDuration(3909), "1:05:09");
  EXPECT_EQ(FormatDuration(-5), "0:00");
}

}  // namespace
}  // namespace acmp
