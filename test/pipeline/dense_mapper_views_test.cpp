#include "../../src/pipeline/dense_mapper_views.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

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
