#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

namespace acmp {
namespace {

TEST(PoseRefinementOptionsTest, ValuesOutOfBoundsAreRefused) {
  PoseRefinementOptions options;
  options.refine = RefinePoses::kOff;
  EXPECT_NO_THROW(Validate(options));
  options.corners = 10;
  EXPECT_THROW(Validate(options), InvalidInputError);
}

TEST(PoseRefinementOptionsTest, TheTableSetsTheMode) {
  PoseRefinementOptions options;
  SetOption(PoseRefinementOptionTable(), "refine_poses=off", &options);
  EXPECT_EQ(options.refine, RefinePoses::kOff);
  SetOption(PoseRefinementOptionTable(), "refine_poses=on", &options);
  EXPECT_EQ(options.refine, RefinePoses::kOn);
  SetOption(PoseRefinementOptionTable(), "refine_poses=auto", &options);
  EXPECT_EQ(options.refine, RefinePoses::kAuto);
}

}  // namespace
}  // namespace acmp
