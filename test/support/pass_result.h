#pragma once

#include <algorithm>

#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// What every pass must leave behind: maps of the camera's size, finite unit normals that face the camera, d > 0,
/// depths in range, costs in 0..max_cost or kUnsupportedCost.
void ExpectValid(const EstimateState& state, const PinholeCamera& camera, const DepthRange& range, float max_cost);

/// Bit for bit.
template <class T>
bool SamePixels(const Image<T>& a, const Image<T>& b) {
  const auto bytes = [](const Image<T>& image) { return reinterpret_cast<const unsigned char*>(image.data()); };
  return a.width() == b.width() && a.height() == b.height() &&
         std::equal(bytes(a), bytes(a) + a.size() * sizeof(T), bytes(b));
}
bool SameBits(const EstimateState& a, const EstimateState& b);

/// Share of the pixels with a true depth whose depth is off by less than `tolerance`, relative.
double ShareWithin(const DepthMap& depth, const DepthMap& truth, double tolerance);

}  // namespace acmp
