#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

#include <cmath>
#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "support/kernel_state.h"
#include "support/random_views.h"

namespace acmp {
namespace {

constexpr int kMapWidth = 40, kMapHeight = 30;

/// Two views, of which the kernels need the first one's camera here.
class SurfaceBreakTest : public ::testing::Test {
 protected:
  /// Planes through `depth(col, row)` at every pixel, facing the camera.
  template <class Depth>
  void SetDepths(const Depth& depth) {
    const RayGrid rays = MakeRayGrid(state_.problem().reference.camera);
    for (int row = 0; row < kMapHeight; ++row) {
      for (int col = 0; col < kMapWidth; ++col) {
        state_.planes(col, row) = PlaneThrough({0, 0, -1}, rays.Ray(static_cast<float>(col), static_cast<float>(row)),
                                               static_cast<float>(depth(col, row)));
      }
    }
  }
  void SetPlane(const PlaneHypothesis& plane) {
    for (PlaneHypothesis& estimate : state_.planes) estimate = plane;
  }
  bool IsBroken(int col, int row) { return IsSurfaceBroken(state_.Context(), col, row, SingleThread()); }

  std::vector<PlanarView> views_ = RandomViews(2, kMapWidth, kMapHeight, 5);
  KernelState state_ = KernelState(MakeProblem(views_, 0, {1, 10}));
};

TEST_F(SurfaceBreakTest, PlanesAreWholeAtAnySlant) {
  for (const double tilt_deg : {0.0, 40.0, 70.0, 80.0}) {
    const double tilt = tilt_deg * 3.14159265358979323846 / 180;
    const PlaneHypothesis plane = {static_cast<float>(std::sin(tilt)), 0, static_cast<float>(-std::cos(tilt)), 3};
    SetPlane(plane);
    const RayGrid rays = MakeRayGrid(state_.problem().reference.camera);
    for (int col = 0; col < kMapWidth; ++col) {
      if (PlaneInverseDepth(plane, rays.Ray(static_cast<float>(col), 15)) <= 0) continue;  // beyond the horizon
      EXPECT_FALSE(IsBroken(col, 15)) << tilt_deg << ": " << col;
    }
  }
}

TEST_F(SurfaceBreakTest, StepsBreakTheWindowsThatReachThem) {
  // The pixel on one side, one of a pair on the other: the second difference is the step.
  SetDepths([](int col, int /*row*/) { return col < 20 ? 4.0 : 4.0 * 1.05; });
  for (int row = 5; row < kMapHeight - 5; ++row) {
    for (int col = 5; col < kMapWidth - 5; ++col) {
      const bool reaches = col - 5 < 20 && col + 5 >= 20;
      EXPECT_EQ(IsBroken(col, row), reaches) << col << ", " << row;
    }
  }
}

TEST_F(SurfaceBreakTest, StepsBelowTheLimitAreNone) {
  SetDepths([](int col, int /*row*/) { return col < 20 ? 4.0 : 4.0 * 1.02; });
  for (int col = 0; col < kMapWidth; ++col) EXPECT_FALSE(IsBroken(col, 15)) << col;
}

TEST_F(SurfaceBreakTest, ThinObjectsBreakTheirOwnWindows) {
  SetDepths([](int col, int /*row*/) { return col == 20 ? 2.0 : 4.0; });
  EXPECT_TRUE(IsBroken(20, 15));
  EXPECT_TRUE(IsBroken(15, 15));
  EXPECT_FALSE(IsBroken(13, 15));
}

TEST_F(SurfaceBreakTest, PairsThatLeaveTheImageDoNotCount) {
  SetDepths([](int col, int /*row*/) { return col < 3 ? 2.0 : 4.0; });
  EXPECT_FALSE(IsBroken(4, 0)) << "every pair leaves the image at the top or on the left";
  EXPECT_TRUE(IsBroken(5, 15));
}

TEST_F(SurfaceBreakTest, WithoutEstimatesNothingIsBroken) {
  SetPlane({});
  EXPECT_FALSE(IsBroken(20, 15));
}

/// The weights that an update gives its window follow sigma_color on a plane and edge_sigma_color at a step; in the
/// photometric pass, which starts from nothing, always sigma_color.
template <Pass kPass>
float SigmaOfUpdate(KernelState* state, int col, int row) {
  StackScratch scratch;
  UpdatePixel<kPass>(state->Context(), col, row, 0, SingleThread(), &scratch.shared);
  const PatchSample sample = scratch.shared.patch.samples[0];
  const float distance = std::hypot(static_cast<float>(WindowCol(0)), static_cast<float>(WindowRow(0)));
  const float spatial = state->options().sigma_spatial_px;
  const float exponent = -std::log(sample.weight) - 0.5f * distance / (spatial * spatial);
  return std::sqrt(0.5f * std::abs(sample.value) / exponent);
}

TEST_F(SurfaceBreakTest, UpdatesUseNarrowerColourWeightsThere) {
  constexpr float kTolerance = 1e-3f;  // the logarithm of a weight of some 1e-3 or more, in float
  for (const int col : {12, 18, 22}) {
    const float expected = col == 12 ? 3.0f : 1.5f;
    for (const auto& [sigma_of_update, sigma] :
         {std::pair(&SigmaOfUpdate<Pass::kPlanarPrior>, expected),
          std::pair(&SigmaOfUpdate<Pass::kGeometric>, expected), std::pair(&SigmaOfUpdate<Pass::kPhotometric>, 3.0f)}) {
      SetDepths([](int i, int /*row*/) { return i < 20 ? 4.0 : 5.0; });
      EXPECT_NEAR(sigma_of_update(&state_, col, 15), sigma, kTolerance) << col;
    }
  }
}

}  // namespace
}  // namespace acmp
