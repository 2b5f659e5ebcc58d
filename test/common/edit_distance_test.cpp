#include "acmp_mapping/common/edit_distance.h"

#include "gtest/gtest.h"

namespace acmp {
namespace {

TEST(EditDistanceTest, FindsTheMostSimilarWord) {
  EXPECT_EQ(MostSimilar("iteration", {"seed", "iterations", "orations"}), "iterations");
  EXPECT_EQ(MostSimilar("xyz", {"ayz", "xbz"}), "ayz") << "the first of equals";
  EXPECT_EQ(MostSimilar("max_source_views", {"min_depth_confidence"}), std::nullopt) << "another thing";
  EXPECT_EQ(MostSimilar("x", {}), std::nullopt);
}

}  // namespace
}  // namespace acmp
