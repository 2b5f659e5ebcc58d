#pragma once

#include <vector>

namespace acmp {

/// Median epipolar residual of the matches between images `gap` to `last_gap` apart in their order.
struct GapFit {
  int gap = 1;
  int last_gap = 1;
  int matches = 0;
  double median_px = 0;
};

/// How well poses fit the images: the distances of matches from their epipolar lines, px. Only matches that no
/// refinement has used count. Where poses are right, a few tenths of a pixel remain; a residual that grows with the gap
/// tells of poses that drift.
struct PoseFit {
  int matches = 0;
  double median_px = 0;        ///< 0 without matches
  std::vector<GapFit> by_gap;  ///< ascending, only those with matches
};

}  // namespace acmp
