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

constexpr double kFar = 1e30;

/// Where the plane of pixel (c, r) meets the ray of pixel (col, row); very far where it leaves the depth range.
double ExtendedDepth(const KernelState& state, const PlaneMap& planes, int c, int r, int col, int row) {
  const double z = reference::Intersect(state.problem().reference.camera, Eigen::Vector2d(col, row),
                                        reference::ToDouble(planes(c, r)))
                       .z();
  const DepthRange& range = state.problem().depth_range;
  return z >= range.min && z <= range.max ? z : kFar;
}

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
      own.depths.push_back(Depth(state, planes, col + dx, row + dy));
      extended.depths.push_back(ExtendedDepth(state, planes, col + dx, row + dy, col, row));
    }
  }
  return extended.Median() < kFar && extended.MiddleHalf() < own.MiddleHalf() ? extended.Median() : own.Median();
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
        MedianFilterPixel(state.Context(), col, row);
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

}  // namespace
}  // namespace acmp
