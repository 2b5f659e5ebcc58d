#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

#include <cmath>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr DepthRange kRange = {1, 10};

/// Random views with masks of a few blocks.
struct MaskedViews {
  explicit MaskedViews(uint32_t seed)
      : views(RandomViews(4, 61, 47, seed)), problem(MakeProblem(views, 0, kRange, true)) {
    TestRandom random(seed);
    for (const PlanarView& view : views) {
      Mask mask(view.camera.width, view.camera.height, 255);
      for (int block = 0; block < 2; ++block) {
        const int left = random.Below(mask.width() - 4), top = random.Below(mask.height() - 3);
        for (int row = top; row < top + 3; ++row) {
          for (int col = left; col < left + 4; ++col) mask(col, row) = 0;
        }
      }
      clearances.push_back(MakeClearance(mask));
      masks.push_back(std::move(mask));
    }
    problem.reference.clearance = clearances[0].View();
    for (size_t i = 0; i < problem.sources.size(); ++i) problem.sources[i].clearance = clearances[i + 1].View();
  }

  std::vector<PlanarView> views;
  std::vector<Mask> masks;
  std::vector<ClearanceMap> clearances;
  PatchMatchProblem problem;
};

/// Whether a position is interpolated with a pixel that the mask ignores.
bool IsMixed(const Mask& mask, const Eigen::Vector2d& position) {
  const double x = std::clamp(position.x(), 0.0, mask.width() - 1.0);
  const double y = std::clamp(position.y(), 0.0, mask.height() - 1.0);
  for (const double col : {std::floor(x), std::ceil(x)}) {
    for (const double row : {std::floor(y), std::ceil(y)}) {
      if (mask(static_cast<int>(col), static_cast<int>(row)) == 0) return true;
    }
  }
  return false;
}

/// Greatest distance of an ignored pixel from the window's middle along an axis, over how far its samples reach.
double DistanceOverReach(const Mask& mask, const Eigen::Vector2d& middle, double reach) {
  double nearest = 1e9;
  for (int row = 0; row < mask.height(); ++row) {
    for (int col = 0; col < mask.width(); ++col) {
      if (mask(col, row) != 0) continue;
      nearest = std::min(nearest, std::max(std::abs(col - middle.x()), std::abs(row - middle.y())));
    }
  }
  return nearest - reach;
}

TEST(MaskedWindowTest, NoWindowWithASampleOfAnIgnoredPixelIsComparedAndFewOthersAreNot) {
  int with_ignored = 0, clear = 0, needlessly = 0;
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    MaskedViews made(seed);
    KernelState state(made.problem);
    const auto context = state.Context();
    TestRandom random(seed + 50);
    for (int trial = 0; trial < 3000; ++trial) {
      const int col = random.Below(61), row = random.Below(47), view = random.Below(3);
      const PlaneHypothesis plane = RandomHypothesis(made.views[0].camera, col, row, 2, 6, 70, &random);
      const PlaneWarp warp = MakePlaneWarp(context.sources[view], PlaneDual(context, plane), static_cast<float>(col),
                                           static_cast<float>(row));
      const MatchView& source = made.problem.sources[static_cast<size_t>(view)];
      const Mask& mask = made.masks[static_cast<size_t>(view) + 1];
      bool is_mixed = false, in_front = true;
      double reach = 0, z = 0;
      const Eigen::Vector2d middle =
          reference::Transfer(made.problem.reference, source, reference::ToDouble(plane), {col, row}, &z);
      if (!(z > 0) || !source.camera.Contains(middle)) continue;
      for (int i = 0; i < kPatchSamples; ++i) {
        const Eigen::Vector2d pixel(col + WindowCol(i), row + WindowRow(i));
        const Eigen::Vector2d there =
            reference::Transfer(made.problem.reference, source, reference::ToDouble(plane), pixel, &z);
        in_front = in_front && z > 0;
        reach = std::max(reach, (there - middle).cwiseAbs().maxCoeff());
        is_mixed = is_mixed || IsMixed(mask, there);
      }
      if (!in_front) continue;
      const bool reaches = ReachesMasked(context, view, warp);
      EXPECT_TRUE(reaches || !is_mixed) << "seed " << seed << ", trial " << trial;
      with_ignored += is_mixed ? 1 : 0;
      const bool is_far = DistanceOverReach(mask, middle, reach) > 2;
      clear += is_far ? 1 : 0;
      needlessly += is_far && reaches ? 1 : 0;
    }
  }
  EXPECT_GT(with_ignored, 500);
  EXPECT_GT(clear, 1500);
  // What is foreshortened reaches less far on one side than is assumed for both.
  EXPECT_LT(needlessly, clear / 20);
}

}  // namespace
}  // namespace acmp
