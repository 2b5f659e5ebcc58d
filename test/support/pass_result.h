#pragma once

#include <algorithm>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/patch_match/patch_match.h"

namespace acmp {

/// What every pass must leave behind: sizes, finite unit normals that face the camera, d > 0, depths in range, costs in
/// 0..max_cost, no bits of views that are not there.
void ExpectValid(const PatchMatchResult& result, const PatchMatchProblem& problem, float max_cost);
/// The same of an estimate, whose pixels may also be unsupported.
void ExpectValid(const EstimateState& state, const PinholeCamera& camera, const DepthRange& range, float max_cost);

/// Bit for bit.
template <class T>
bool SamePixels(const Image<T>& a, const Image<T>& b) {
  const auto bytes = [](const Image<T>& image) { return reinterpret_cast<const unsigned char*>(image.data()); };
  return a.width() == b.width() && a.height() == b.height() &&
         std::equal(bytes(a), bytes(a) + a.size() * sizeof(T), bytes(b));
}
bool SameBits(const PatchMatchResult& a, const PatchMatchResult& b);
bool SameBits(const EstimateState& a, const EstimateState& b);

/// Share of the pixels with ground truth whose depth is off by less than `tolerance`, relative.
double ShareWithin(const PatchMatchResult& result, const PatchMatchProblem& problem, const DepthMap& truth,
                   double tolerance);

/// Share of pixels where two results' depths differ by less than `tolerance`, relative.
double ShareEqual(const PatchMatchResult& a, const PatchMatchResult& b, const PinholeCamera& camera, double tolerance);

}  // namespace acmp
