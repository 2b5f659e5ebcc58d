#include "../../src/pipeline/dense_mapper_views.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(RemapSelectedViewsTest, BitsFollowIds) {
  Image<uint32_t> masks(2, 1);
  masks(0, 0) = 0b1011;  // keyframes 5, 7 and 2
  masks(1, 0) = 0b0100;  // keyframe 9
  const Image<uint32_t> remapped = RemapSelectedViews(masks, {5, 7, 9, 2}, {2, 8, 9, 5});
  EXPECT_EQ(remapped(0, 0), 0b1001u);  // 2 and 5; 7 is gone, 8 is new
  EXPECT_EQ(remapped(1, 0), 0b0100u);
}

TEST(RemapSelectedViewsTest, AllBitsOfThe32) {
  std::vector<int64_t> ids;
  for (int64_t id = 0; id < 32; ++id) ids.push_back(id);
  const std::vector<int64_t> reversed(ids.rbegin(), ids.rend());
  const Image<uint32_t> masks(1, 1, 0x80000003u);
  EXPECT_EQ(RemapSelectedViews(masks, ids, ids)(0, 0), 0x80000003u);
  EXPECT_EQ(RemapSelectedViews(masks, ids, reversed)(0, 0), 0xc0000001u);
  EXPECT_EQ(RemapSelectedViews(masks, ids, {})(0, 0), 0u);
  EXPECT_TRUE(RemapSelectedViews({}, ids, reversed).empty());
}

TEST(DescribeMissingViewsTest, NamesOnlyWhatThereIs) {
  SourceViewCounts counts;
  EXPECT_THAT(DescribeMissingViews(counts, 2, {}), AllOf(HasSubstr("no other keyframe"), HasSubstr("2")));
  counts.useful = 1;
  counts.small_angle = 3;
  counts.largest_angle_deg = 5.25;
  EXPECT_THAT(DescribeMissingViews(counts, 2, {}), AllOf(HasSubstr("1 of 4"), HasSubstr("3 below"), HasSubstr("5.25"),
                                                         Not(HasSubstr("baseline")), Not(HasSubstr("%"))));
  counts.little_overlap = 2;
  counts.no_baseline = 1;
  EXPECT_THAT(DescribeMissingViews(counts, 2, {}),
              AllOf(HasSubstr("1 of 7"), HasSubstr("2 see less than 10 %"), HasSubstr("1 with no baseline")));
}

}  // namespace
}  // namespace acmp
