#include "acmp_mapping/patch_match/kernel/geometric_cost.h"

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"

// Where it is not what papers_test.cpp compares: the ends of what sources see.

namespace acmp {
namespace {

TEST(GeometricErrorTest, IsTheTruncationWhereThereIsNothingToCompare) {
  std::vector<PlanarView> views = RandomViews(6, 33, 27, 3);
  views[1].cam_from_world = LookAhead({0, 0, 0.1}, 180, 0, 0);  // the point is behind the source
  views[2].cam_from_world = LookAhead({30, 0, 0}, 0, 0, 0);     // outside its image
  for (float& depth : views[3].depth) depth = 0;                // no depth there
  for (float& depth : views[5].depth) depth = -1;               // nonsense
  PatchMatchOptions options;
  options.geometric_max_px = 3.5f;
  PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  problem.sources[3].depth = {};  // no map at all
  KernelState state(problem, options);
  for (int view = 0; view < 5; ++view) EXPECT_EQ(GeometricError(state.Context(), 4, 16, 13, view), 3.5f) << view;
}

TEST(GeometricErrorTest, BackwardPointBehindTheReferenceIsTruncated) {
  // The source stands 5 m ahead on the optical axis, looking back at the reference; its depth claims a surface 8 m
  // away, which lies 3 m behind the reference camera. On the axis a point behind has the pixel of one in front.
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  views[1].cam_from_world = LookAhead({0, 0, 5}, 180, 0, 0);
  for (float& depth : views[1].depth) depth = 8;
  PatchMatchOptions options;
  options.geometric_max_px = 5;
  KernelState behind(MakeProblem(views, 0, {1, 10}, true), options);
  EXPECT_EQ(GeometricError(behind.Context(), 3, 16, 13, 0), 5.0f);
  for (float& depth : views[1].depth) depth = 2;
  KernelState before(MakeProblem(views, 0, {1, 10}, true), options);
  EXPECT_LT(GeometricError(before.Context(), 3, 16, 13, 0), 0.01f);
}

}  // namespace
}  // namespace acmp
