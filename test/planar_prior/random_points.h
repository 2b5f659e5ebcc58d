#pragma once

#include <random>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Distinct pixels of a width x height image, the image's border included, all at depth 1.
inline std::vector<SupportPoint> RandomPoints(int width, int height, int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<int> any_col(0, width - 1), any_row(0, height - 1);
  std::set<std::pair<int, int>> taken;
  std::vector<SupportPoint> points;
  while (static_cast<int>(points.size()) < count) {
    const int col = any_col(generator), row = any_row(generator);
    if (taken.insert({col, row}).second) points.push_back({col, row, 1.0f});
  }
  return points;
}

}  // namespace acmp
