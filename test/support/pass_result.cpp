#include "support/pass_result.h"

#include <cmath>

#include "gtest/gtest.h"

namespace acmp {
namespace {

double RelativeShare(const DepthMap& depth, const DepthMap& truth, double tolerance) {
  size_t within = 0, counted = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!(truth.data()[i] > 0)) continue;
    ++counted;
    within += std::abs(depth.data()[i] / truth.data()[i] - 1) < tolerance;
  }
  return static_cast<double>(within) / static_cast<double>(counted);
}

template <class T>
void ExpectSize(const Image<T>& image, const PinholeCamera& camera) {
  ASSERT_EQ(image.width(), camera.width);
  ASSERT_EQ(image.height(), camera.height);
}

void ExpectValidMaps(const PlaneMap& planes, const CostMap& costs, const PinholeCamera& camera, const DepthRange& range,
                     float max_cost, bool may_be_unsupported) {
  ASSERT_NO_FATAL_FAILURE(ExpectSize(planes, camera));
  ASSERT_NO_FATAL_FAILURE(ExpectSize(costs, camera));
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const PlaneHypothesis& plane = planes(col, row);
      const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
      ASSERT_NEAR(normal.norm(), 1, 1e-5) << col << ", " << row;
      ASSERT_TRUE(plane.d > 0 && std::isfinite(plane.d)) << col << ", " << row;
      // d is depth times a scalar product, and depth is recovered by dividing by it: two roundings.
      const double depth = -plane.d / normal.dot(camera.Unproject({1.0 * col, 1.0 * row}));
      // Near edge-on the scalar product itself rounds differently in float: 1e-7 of a unit over its size.
      const double slack = 1e-6 + 1e-6 / std::abs(normal.dot(camera.Unproject({1.0 * col, 1.0 * row})));
      ASSERT_TRUE(depth >= range.min * (1 - slack) && depth <= range.max * (1 + slack))
          << depth << " at " << col << ", " << row;
      const float cost = costs(col, row);
      const bool is_unsupported = may_be_unsupported && cost == kUnsupportedCost;
      ASSERT_TRUE(is_unsupported || (cost >= 0 && cost <= max_cost)) << cost << " at " << col << ", " << row;
    }
  }
}

}  // namespace

void ExpectValid(const PatchMatchResult& result, const PatchMatchProblem& problem, float max_cost) {
  const PinholeCamera& camera = problem.reference.camera;
  ASSERT_NO_FATAL_FAILURE(ExpectValidMaps(result.planes, result.cost, camera, problem.depth_range, max_cost, false));
  ASSERT_NO_FATAL_FAILURE(ExpectSize(result.selected_views, camera));
  for (const uint32_t views : result.selected_views) ASSERT_EQ(uint64_t{views} >> problem.sources.size(), 0u);
}

void ExpectValid(const EstimateState& state, const PinholeCamera& camera, const DepthRange& range, float max_cost) {
  ExpectValidMaps(state.planes, state.cost, camera, range, max_cost, true);
}

bool SameBits(const PatchMatchResult& a, const PatchMatchResult& b) {
  return SamePixels(a.planes, b.planes) && SamePixels(a.cost, b.cost) && SamePixels(a.selected_views, b.selected_views);
}

bool SameBits(const EstimateState& a, const EstimateState& b) {
  return SamePixels(a.planes, b.planes) && SamePixels(a.cost, b.cost);
}

double ShareWithin(const PatchMatchResult& result, const PatchMatchProblem& problem, const DepthMap& truth,
                   double tolerance) {
  return RelativeShare(ToDepthMap(result.planes, problem.reference.camera), truth, tolerance);
}

double ShareEqual(const PatchMatchResult& a, const PatchMatchResult& b, const PinholeCamera& camera, double tolerance) {
  return RelativeShare(ToDepthMap(a.planes, camera), ToDepthMap(b.planes, camera), tolerance);
}

}  // namespace acmp
