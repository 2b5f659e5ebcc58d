#include "acmp_mapping/patch_match/kernel/median_filter.h"

#include <algorithm>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

/// Where the plane of pixel (c, r) meets the ray of pixel (col, row).
double Depth(const KernelState& state, const PlaneMap& planes, int c, int r, int col, int row) {
  return reference::Intersect(state.problem().reference.camera, Eigen::Vector2d(col, row),
                              reference::ToDouble(planes(c, r)))
      .z();
}

constexpr double kFar = 1e30;  // of a plane that leaves the depth range

struct ReferenceSpread {
  std::vector<double> depths;
  double Median() {
    std::sort(depths.begin(), depths.end());
    return depths[depths.size() / 2];  // the upper middle one of an even number
  }
  double MiddleHalf() {
    std::sort(depths.begin(), depths.end());
    return depths[3 * depths.size() / 4] - depths[depths.size() / 4];
  }
};

/// Over the pixel, those of the other colour within 3 px (Euclidean), that is, the 16 nearest, and four 5 px along the
/// axes.
double ReferenceMedian(const KernelState& state, const PlaneMap& planes, int col, int row) {
  ReferenceSpread own, extended;
  for (int dy = -5; dy <= 5; ++dy) {
    for (int dx = -5; dx <= 5; ++dx) {
      const bool self = dx == 0 && dy == 0;
      const bool near_of_other_color = (dx + dy) % 2 != 0 && dx * dx + dy * dy <= 9;
      const bool axis_end = dx * dy == 0 && dx * dx + dy * dy == 25;
      if (!self && !near_of_other_color && !axis_end) continue;
      if (!planes.View().Contains(col + dx, row + dy)) continue;
      const int c = col + dx, r = row + dy;
      own.depths.push_back(Depth(state, planes, c, r, c, r));
      const double z = Depth(state, planes, c, r, col, row);
      const DepthRange& range = state.problem().depth_range;
      extended.depths.push_back(z >= range.min && z <= range.max ? z : kFar);
    }
  }
  return extended.Median() < kFar && extended.MiddleHalf() < own.MiddleHalf() ? extended.Median() : own.Median();
}

TEST(MedianFilterTest, MovesThePlaneToTheMedianDepthAndKeepsItsNormal) {
  for (const auto& [width, height] : {std::pair(21, 17), {1, 1}, {2, 3}, {1, 9}, {4, 4}}) {
    const std::vector<PlanarView> views = RandomViews(2, width, height, 1);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(2);
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        state.planes(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
      }
    }
    const PlaneMap before = state.planes.Clone();
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        std::copy(before.begin(), before.end(), state.planes.begin());
        MedianFilterPixel(state.Context(), col, row);
        ASSERT_NEAR(Depth(state, state.planes, col, row, col, row), ReferenceMedian(state, before, col, row), 1e-5)
            << col << ", " << row << " of " << width << " x " << height;
        ASSERT_EQ(state.planes(col, row).nx, before(col, row).nx);
        ASSERT_EQ(state.planes(col, row).ny, before(col, row).ny);
        ASSERT_EQ(state.planes(col, row).nz, before(col, row).nz);
        ASSERT_GT(state.planes(col, row).d, 0);
      }
    }
  }
}

}  // namespace
}  // namespace acmp
