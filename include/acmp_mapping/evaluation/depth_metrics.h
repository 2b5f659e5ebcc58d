#pragma once

#include <array>
#include <vector>

#include "acmp_mapping/image/image.h"

namespace acmp {

constexpr std::array<double, 3> kAbsoluteThresholds = {0.02, 0.05, 0.10};  ///< scene units (metres)
constexpr std::array<double, 3> kRelativeThresholds = {0.01, 0.02, 0.05};

/// Shares are in percent of all ground-truth pixels; a ground-truth pixel without an estimate counts as wrong.
struct DepthMetrics {
  size_t ground_truth_pixels = 0;
  std::array<double, 3> below_absolute = {};
  std::array<double, 3> below_relative = {};
  double density = 0;       ///< ground-truth pixels that have an estimate
  double median_error = 0;  ///< over those that have one; NaN when none
};

/// Gathers the pixels of one image or of several (a pool).
class DepthErrors {
 public:
  /// Adds every pixel with ground truth (finite and > 0) where `mask` (ground truth's size, may be empty) is not 0. An
  /// estimate that is not finite and > 0 is missing; one of another size is looked up at the nearest pixel centre, one
  /// without pixels is missing everywhere. Throws InvalidInputError for a mask of another size.
  void Add(const DepthMap& estimate, const DepthMap& ground_truth, ImageView<const unsigned char> mask = {});

  /// All shares and the median are NaN when no pixel with ground truth was added.
  DepthMetrics Metrics() const;

 private:
  size_t ground_truth_pixels_ = 0;
  std::array<size_t, 3> below_absolute_ = {};
  std::array<size_t, 3> below_relative_ = {};
  std::vector<float> errors_;  // of the pixels that have an estimate
};

/// Median of true over estimated depth, where both are known; 1 where none is.
double MedianScale(const DepthMap& estimate, const DepthMap& ground_truth);

/// Compares at every pixel with ground truth (> 0); an estimate of another size is looked up at the nearest pixel
/// centre. `mask` (ground truth's size, may be empty) restricts to pixels where it is not 0.
DepthMetrics EvaluateDepth(const DepthMap& estimate, const DepthMap& ground_truth,
                           ImageView<const unsigned char> mask = {});

/// Mean over images, each image with the same weight; images without ground truth are left out, and from the median's
/// mean also those without an estimate. NaN when nothing remains.
DepthMetrics Mean(const std::vector<DepthMetrics>& metrics);

}  // namespace acmp
