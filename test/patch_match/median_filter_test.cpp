#include "acmp_mapping/patch_match/kernel/median_filter.h"

#include <algorithm>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

void RandomPlanes(KernelState* state, uint32_t seed) {
  TestRandom random(seed);
  for (int row = 0; row < state->height(); ++row) {
    for (int col = 0; col < state->width(); ++col) {
      state->planes(col, row) = RandomHypothesis(state->problem().reference.camera, col, row, 2, 8, 60, &random);
    }
  }
}

double Depth(const KernelState& state, const PlaneMap& planes, int col, int row) {
  return reference::Intersect(state.problem().reference.camera, Eigen::Vector2d(col, row),
                              reference::ToDouble(planes(col, row)))
      .z();
}

/// The pixel, those of the other colour within 3 px (Euclidean), that is, the 16 nearest, and four 5 px along the axes;
/// the upper middle one of an even number.
double ReferenceMedian(const KernelState& state, const PlaneMap& planes, int col, int row) {
  std::vector<double> depths;
  for (int dy = -5; dy <= 5; ++dy) {
    for (int dx = -5; dx <= 5; ++dx) {
      const bool self = dx == 0 && dy == 0;
      const bool near_of_other_color = (dx + dy) % 2 != 0 && dx * dx + dy * dy <= 9;
      const bool axis_end = dx * dy == 0 && dx * dx + dy * dy == 25;
      if (!self && !near_of_other_color && !axis_end) continue;
      if (!planes.View().Contains(col + dx, row + dy)) continue;
      depths.push_back(Depth(state, planes, col + dx, row + dy));
    }
  }
  std::sort(depths.begin(), depths.end());
  return depths[depths.size() / 2];
}

TEST(MedianFilterTest, MovesThePlaneToTheMedianDepthAndKeepsItsNormal) {
  for (const auto& [width, height] : {std::pair(21, 17), {1, 1}, {2, 3}, {1, 9}, {4, 4}}) {
    const std::vector<PlanarView> views = RandomViews(2, width, height, 1);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    RandomPlanes(&state, 2);
    const PlaneMap before = state.planes.Clone();
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        std::copy(before.begin(), before.end(), state.planes.begin());
        FilterPixel(state.Context(), col, row);
        ASSERT_NEAR(Depth(state, state.planes, col, row), ReferenceMedian(state, before, col, row), 1e-5)
            << col << ", " << row << " of " << width << " x " << height;
        ASSERT_EQ(state.planes(col, row).nx, before(col, row).nx);
        ASSERT_EQ(state.planes(col, row).ny, before(col, row).ny);
        ASSERT_EQ(state.planes(col, row).nz, before(col, row).nz);
        ASSERT_GT(state.planes(col, row).d, 0);
      }
    }
  }
}

TEST(MedianFilterTest, RemovesAnOutlierAndKeepsAPlane) {
  const std::vector<PlanarView> views = RandomViews(2, 15, 15, 3);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  for (PlaneHypothesis& plane : state.planes) plane = {0, 0, -1, 4};
  state.planes(7, 7) = {0, 0, -1, 9};
  FilterPixel(state.Context(), 7, 7);
  EXPECT_NEAR(Depth(state, state.planes, 7, 7), 4, 1e-6);
  FilterPixel(state.Context(), 8, 8);
  EXPECT_NEAR(Depth(state, state.planes, 8, 8), 4, 1e-6);
}

TEST(MedianFilterTest, KeepsADepthEdge) {
  const std::vector<PlanarView> views = RandomViews(2, 20, 15, 4);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  for (int row = 0; row < 15; ++row) {
    for (int col = 0; col < 20; ++col) state.planes(col, row) = {0, 0, -1, col < 10 ? 3.0f : 6.0f};
  }
  for (int color = 0; color < 2; ++color) {
    for (int row = 4; row < 11; ++row) {
      for (int col = 4; col < 16; ++col) {
        if ((col + row) % 2 == color) FilterPixel(state.Context(), col, row);
      }
    }
  }
  for (int col = 4; col < 16; ++col) EXPECT_NEAR(Depth(state, state.planes, col, 7), col < 10 ? 3 : 6, 1e-5) << col;
}

}  // namespace
}  // namespace acmp
