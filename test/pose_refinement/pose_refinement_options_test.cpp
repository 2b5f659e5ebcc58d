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
  OptionsOf(&options).Set("refine_poses=off");
  EXPECT_EQ(options.refine, RefinePoses::kOff);
  OptionsOf(&options).Set("refine_poses=on");
  EXPECT_EQ(options.refine, RefinePoses::kOn);
}

}  // namespace
}  // namespace acmp
