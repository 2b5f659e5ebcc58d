#include "support/pass_result.h"

#include <cmath>

#include "gtest/gtest.h"

namespace acmp {
namespace {

void ExpectSize(int width, int height, const PinholeCamera& camera) {
  ASSERT_EQ(width, camera.width);
  ASSERT_EQ(height, camera.height);
}

}  // namespace

void ExpectValid(const EstimateState& state, const PinholeCamera& camera, const DepthRange& range, float max_cost) {
  ASSERT_NO_FATAL_FAILURE(ExpectSize(state.planes.width(), state.planes.height(), camera));
  ASSERT_NO_FATAL_FAILURE(ExpectSize(state.cost.width(), state.cost.height(), camera));
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const PlaneHypothesis& plane = state.planes(col, row);
      const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
      ASSERT_NEAR(normal.norm(), 1, 1e-5) << col << ", " << row;
      ASSERT_TRUE(plane.d > 0 && std::isfinite(plane.d)) << col << ", " << row;
      // d is depth times a scalar product, and depth is recovered by dividing by it: two roundings.
      const double depth = -plane.d / normal.dot(camera.Unproject({1.0 * col, 1.0 * row}));
      // Near edge-on the scalar product itself rounds differently in float: 1e-7 of a unit over its size.
      const double slack = 1e-6 + 1e-6 / std::abs(normal.dot(camera.Unproject({1.0 * col, 1.0 * row})));
      ASSERT_TRUE(depth >= range.min * (1 - slack) && depth <= range.max * (1 + slack))
          << depth << " at " << col << ", " << row;
      const float cost = state.cost(col, row);
      ASSERT_TRUE(cost == kUnsupportedCost || (cost >= 0 && cost <= max_cost)) << cost << " at " << col << ", " << row;
    }
  }
}

bool SameBits(const EstimateState& a, const EstimateState& b) {
  return SamePixels(a.planes, b.planes) && SamePixels(a.cost, b.cost);
}

double ShareWithin(const DepthMap& depth, const DepthMap& truth, double tolerance) {
  size_t within = 0, counted = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!(truth.data()[i] > 0)) continue;
    ++counted;
    within += std::abs(depth.data()[i] / truth.data()[i] - 1) < tolerance;
  }
  return static_cast<double>(within) / static_cast<double>(counted);
}

}  // namespace acmp
