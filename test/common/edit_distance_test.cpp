#include "acmp_mapping/common/edit_distance.h"

#include "gtest/gtest.h"

namespace acmp {
namespace {

TEST(EditDistanceTest, CountsSingleLetterEdits) {
  EXPECT_EQ(EditDistance("", ""), 0u);
  EXPECT_EQ(EditDistance("abc", ""), 3u);
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3u);
  EXPECT_EQ(EditDistance("sitting", "kitten"), 3u);
}

TEST(EditDistanceTest, FindsTheMostSimilarWord) {
  EXPECT_EQ(MostSimilar("iteration", {"seed", "iterations", "orations"}), "iterations");
  EXPECT_EQ(MostSimilar("x", {"ab", "cd"}), "ab") << "the first of equals";
}

}  // namespace
}  // namespace acmp
