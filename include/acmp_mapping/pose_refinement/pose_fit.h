#pragma once

#include <optional>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"

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

/// What cameras do that poses and a pinhole cannot say. It is estimated together with the poses, since a bundle
/// adjustment that does not know it bends the scene to explain it.
struct CameraErrors {
  double k1 = 0;  ///< radial distortion that is left: a pixel at x (z = 1) is seen at x (1 + k1 r^2 + k2 r^4)
  double k2 = 0;
  double readout = 0;  ///< time from the first image row to the last (rolling shutter): seconds where images have
                       ///< stamps, else in units of the interval from image to image
};

/// How far radial distortion moves a pixel, px outwards.
/// @param place of the pixel: 0 is the middle, 1 the corner farthest from it
double DistortionShift(const PinholeCamera& camera, const CameraErrors& errors, double place);

/// So many of the newest images tell whether received poses contradict the images.
constexpr size_t kContradictionImages = 10;

/// Faults of received poses and of the calibration that a sliding window shows.
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
  /// What the calibration leaves. None: not yet known well.
  std::optional<CameraErrors> camera_errors;
  /// Clearly: camera_errors explain held-out matches better than any poses of a camera without errors.
  bool has_camera_errors = false;
};

}  // namespace acmp
