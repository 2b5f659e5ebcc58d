#pragma once

#include <optional>
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

/// So many of the newest images tell whether received poses contradict the images.
constexpr size_t kContradictionImages = 10;

/// Faults of received poses that a sliding window shows.
struct PoseChecks {
  /// How far the received poses of the last kContradictionImages contradict the images, rad: what is left between
  /// received and refined poses after the similarity that fits them best, as the median of the angles plus the median
  /// of the distances over the landmarks' typical depth. That is by which share of their depth these images' maps come
  /// to lie apart. Noise of single poses hardly counts, motions of a wrong length or direction do. None: fewer than six
  /// images or too few matches.
  std::optional<double> contradiction;
  /// So many seconds after their stamps the camera was where the received poses say, all of them alike. None: they show
  /// no such offset of at least 10 ms, the camera hardly turns, or there are no stamps.
  std::optional<double> stamp_offset_s;
  /// How far radial distortion that is left in the images moves a pixel 0.7 of the way from the middle to the corner,
  /// px outwards. None: not yet known well.
  std::optional<double> distortion_px;
};

}  // namespace acmp
