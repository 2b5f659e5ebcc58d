#include "support/pass_result.h"

#include <cmath>
#include <cstring>

#include "gtest/gtest.h"

namespace acmp {
namespace {

template <class T>
bool SameBytes(const Image<T>& a, const Image<T>& b) {
  return a.width() == b.width() && a.height() == b.height() &&
         std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

double RelativeShare(const DepthMap& depth, const DepthMap& truth, double tolerance) {
  size_t within = 0, counted = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!(truth.data()[i] > 0)) continue;
    ++counted;
    within += std::abs(depth.data()[i] / truth.data()[i] - 1) < tolerance;
  }
  return static_cast<double>(within) / static_cast<double>(counted);
}

}  // namespace

void ExpectValid(const PatchMatchResult& result, const PatchMatchProblem& problem, float max_cost) {
  const PinholeCamera& camera = problem.reference.camera;
  for (const auto& [width, height] : {std::pair(result.planes.width(), result.planes.height()),
                                      {result.cost.width(), result.cost.height()},
                                      {result.selected_views.width(), result.selected_views.height()}}) {
    ASSERT_EQ(width, camera.width);
    ASSERT_EQ(height, camera.height);
  }
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const PlaneHypothesis& plane = result.planes(col, row);
      const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
      ASSERT_NEAR(normal.norm(), 1, 1e-5) << col << ", " << row;
      ASSERT_TRUE(plane.d > 0 && std::isfinite(plane.d)) << col << ", " << row;
      // d is depth times a scalar product, and depth is recovered by dividing by it: two roundings.
      const double depth = -plane.d / normal.dot(camera.Unproject({1.0 * col, 1.0 * row}));
      // Near edge-on the scalar product itself rounds differently in float: 1e-7 of a unit over its size.
      const double slack = 1e-6 + 1e-6 / std::abs(normal.dot(camera.Unproject({1.0 * col, 1.0 * row})));
      ASSERT_TRUE(depth >= problem.depth_range.min * (1 - slack) && depth <= problem.depth_range.max * (1 + slack))
          << depth << " at " << col << ", " << row;
      const float cost = result.cost(col, row);
      ASSERT_TRUE(cost >= 0 && cost <= max_cost) << cost << " at " << col << ", " << row;
      ASSERT_EQ(uint64_t{result.selected_views(col, row)} >> problem.sources.size(), 0u) << col << ", " << row;
    }
  }
}

bool SameBits(const PatchMatchResult& a, const PatchMatchResult& b) {
  return SameBytes(a.planes, b.planes) && SameBytes(a.cost, b.cost) && SameBytes(a.selected_views, b.selected_views);
}

double ShareWithin(const PatchMatchResult& result, const PatchMatchProblem& problem, const DepthMap& truth,
                   double tolerance) {
  return RelativeShare(ToDepthMap(result.planes, problem.reference.camera), truth, tolerance);
}

double ShareEqual(const PatchMatchResult& a, const PatchMatchResult& b, const PinholeCamera& camera, double tolerance) {
  return RelativeShare(ToDepthMap(a.planes, camera), ToDepthMap(b.planes, camera), tolerance);
}

}  // namespace acmp
