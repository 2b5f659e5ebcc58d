#include "acmp_mapping/patch_match/kernel/geometric_cost.h"

#include <algorithm>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

/// As in the paper.
PatchMatchOptions TruncatedAt5() {
  PatchMatchOptions options;
  options.geometric_max_px = 5;
  return options;
}

float KernelError(KernelState* state, float depth, int col, int row, int view) {
  return GeometricError(state->Context(), depth, col, row, view);
}

TEST(GeometricErrorTest, AgreesWithTheReferenceOnRandomDepths) {
  std::vector<PlanarView> views = RandomViews(5, 65, 49, 1);
  for (PlanarView& view : views) {  // the right half is a surface, of 3 to 6 % in a step of the halved map
    for (int row = 0; row < view.camera.height; ++row) {
      for (int col = view.camera.width / 2; col < view.camera.width; ++col) {
        view.depth(col, row) =
            2 + 0.05f * static_cast<float>(col - view.camera.width / 2) + 0.01f * static_cast<float>(row);
      }
    }
  }
  PatchMatchOptions options;
  options.geometric_max_px = 12;
  KernelState state(MakeProblem(views, 0, {1, 10}, true), options);
  TestRandom random(2);
  int finite = 0, truncated = 0;
  for (int i = 0; i < 20000; ++i) {
    const int col = random.Below(65), row = random.Below(49), view = i % 4;
    const auto depth = static_cast<float>(random(1, 10));
    const double expected = reference::ReprojectionError(state.problem(), depth, col, row, view);
    // Positions of about 65 px round to some 1e-5 px. Where that decides which source pixel is read, or whether one is
    // (positions within 1e-4 of a half), the answers may differ.
    const double nudged_up = reference::ReprojectionError(state.problem(), depth * (1 + 1e-5), col, row, view);
    const double nudged_down = reference::ReprojectionError(state.problem(), depth * (1 - 1e-5), col, row, view);
    const auto truncate = [](double e) { return std::min(e, 12.0); };
    if (std::abs(truncate(nudged_up) - truncate(nudged_down)) > 0.01) continue;
    ASSERT_NEAR(KernelError(&state, depth, col, row, view), truncate(expected), 2e-3) << col << ", " << row;
    ++(expected < 12 ? finite : truncated);
  }
  EXPECT_GT(finite, 5000);
  EXPECT_GT(truncated, 500);
}

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
  for (int view = 0; view < 5; ++view) EXPECT_EQ(KernelError(&state, 4, 16, 13, view), 3.5f) << view;
}

TEST(GeometricErrorTest, BackwardPointBehindTheReferenceIsTruncated) {
  // The source stands 5 m ahead on the optical axis, looking back at the reference; its depth claims a surface 8 m
  // away, which lies 3 m behind the reference camera. On the axis a point behind has the pixel of one in front.
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  views[1].cam_from_world = LookAhead({0, 0, 5}, 180, 0, 0);
  for (float& depth : views[1].depth) depth = 8;
  KernelState behind(MakeProblem(views, 0, {1, 10}, true), TruncatedAt5());
  EXPECT_EQ(KernelError(&behind, 3, 16, 13, 0), 5.0f);
  for (float& depth : views[1].depth) depth = 2;
  KernelState before(MakeProblem(views, 0, {1, 10}, true), TruncatedAt5());
  EXPECT_LT(KernelError(&before, 3, 16, 13, 0), 0.01f);
}

}  // namespace
}  // namespace acmp
