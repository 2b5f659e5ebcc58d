#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// What every pass must leave behind: maps of the camera's size, finite unit normals that face the camera, d > 0,
/// depths in range, costs in 0..max_cost or kUnsupportedCost.
inline void ExpectValid(const EstimateState& state, const PinholeCamera& camera, const DepthRange& range,
                        float max_cost) {
  for (const auto& [width, height] :
       {std::pair(state.planes.width(), state.planes.height()), std::pair(state.cost.width(), state.cost.height())}) {
    ASSERT_EQ(width, camera.width);
    ASSERT_EQ(height, camera.height);
  }
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

/// Bit for bit.
template <class T>
bool SamePixels(const Image<T>& a, const Image<T>& b) {
  const auto bytes = [](const Image<T>& image) { return reinterpret_cast<const unsigned char*>(image.data()); };
  return a.width() == b.width() && a.height() == b.height() &&
         std::equal(bytes(a), bytes(a) + a.size() * sizeof(T), bytes(b));
}
inline bool SameBits(const EstimateState& a, const EstimateState& b) {
  return SamePixels(a.planes, b.planes) && SamePixels(a.cost, b.cost);
}

/// Share of the pixels with a true depth whose depth is off by less than `tolerance`, relative.
inline double ShareWithin(const DepthMap& depth, const DepthMap& truth, double tolerance) {
  size_t within = 0, counted = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!(truth.data()[i] > 0)) continue;
    ++counted;
    within += std::abs(depth.data()[i] / truth.data()[i] - 1) < tolerance;
  }
  return static_cast<double>(within) / static_cast<double>(counted);
}

}  // namespace acmp
