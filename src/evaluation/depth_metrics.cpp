#include "acmp_mapping/evaluation/depth_metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Nearest pixel of an estimate `size` px long for each of `target_size` pixels: u -> (u + 0.5) s - 0.5, halves to even.
// Empty where the estimate is.
std::vector<int> NearestPixels(int size, int target_size) {
  if (size == 0) return {};
  std::vector<int> nearest(target_size);
  for (int i = 0; i < target_size; ++i) {
    const double position = (i + 0.5) * size / target_size - 0.5;
    nearest[i] = std::clamp(static_cast<int>(std::nearbyint(position)), 0, size - 1);
  }
  return nearest;
}

// As numpy.median: NaN of none, of an even number the mean of the two in the middle. Reorders its argument.
double MedianOrNan(std::vector<float>* values) {
  if (values->empty()) return kNan;
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  if (values->size() % 2 == 1) return *middle;
  return 0.5f * (*std::max_element(values->begin(), middle) + *middle);
}

// Calls visit(true depth, estimated depth) for all pixels with ground truth where the mask, if there is one, is not 0.
template <class Visit>
void ForEachTruePixel(const DepthMap& estimate, const DepthMap& ground_truth, ImageView<const unsigned char> mask,
                      const Visit& visit) {
  const std::vector<int> cols = NearestPixels(estimate.width(), ground_truth.width());
  const std::vector<int> rows = NearestPixels(estimate.height(), ground_truth.height());
  for (int row = 0; row < ground_truth.height(); ++row) {
    for (int col = 0; col < ground_truth.width(); ++col) {
      const float truth = ground_truth(col, row);
      if (!IsKnown(truth) || (!mask.empty() && mask(col, row) == 0)) continue;
      visit(truth, estimate.empty() ? 0.0f : estimate(cols[col], rows[row]));
    }
  }
}

}  // namespace

double MedianScale(const DepthMap& estimate, const DepthMap& ground_truth) {
  std::vector<float> ratios;
  ForEachTruePixel(estimate, ground_truth, {}, [&](float truth, float depth) {
    if (IsKnown(depth)) ratios.push_back(truth / depth);
  });
  return ratios.empty() ? 1 : MedianOrNan(&ratios);
}

void DepthErrors::Add(const DepthMap& estimate, const DepthMap& ground_truth, ImageView<const unsigned char> mask) {
  if (!mask.empty() && (mask.width != ground_truth.width() || mask.height != ground_truth.height())) {
    throw InvalidInputError(Concat("mask size ", mask.width, " x ", mask.height, ": must be the ground truth's, ",
                                   ground_truth.width(), " x ", ground_truth.height()));
  }
  ForEachTruePixel(estimate, ground_truth, mask, [&](float truth, float depth) {
    ++ground_truth_pixels_;
    if (!IsKnown(depth)) return;
    // In float like the maps: with millimetre files many errors lie exactly on a threshold, and rounding decides.
    const float error = std::abs(depth - truth);
    errors_.push_back(error);
    for (size_t i = 0; i < kAbsoluteThresholds.size(); ++i) {
      below_absolute_[i] += error < static_cast<float>(kAbsoluteThresholds[i]);
      below_relative_[i] += error < static_cast<float>(kRelativeThresholds[i]) * truth;
    }
  });
}

DepthMetrics DepthErrors::Metrics() const {
  DepthMetrics metrics;
  metrics.ground_truth_pixels = ground_truth_pixels_;
  const auto percent = [&](size_t count) {
    return ground_truth_pixels_ == 0 ? kNan : 100.0 * static_cast<double>(count) / ground_truth_pixels_;
  };
  for (size_t i = 0; i < kAbsoluteThresholds.size(); ++i) {
    metrics.below_absolute[i] = percent(below_absolute_[i]);
    metrics.below_relative[i] = percent(below_relative_[i]);
  }
  metrics.density = percent(errors_.size());
  std::vector<float> errors = errors_;
  metrics.median_error = MedianOrNan(&errors);
  return metrics;
}

DepthMetrics EvaluateDepth(const DepthMap& estimate, const DepthMap& ground_truth,
                           ImageView<const unsigned char> mask) {
  DepthErrors errors;
  errors.Add(estimate, ground_truth, mask);
  return errors.Metrics();
}

DepthMetrics Mean(const std::vector<DepthMetrics>& metrics) {
  const auto mean_of = [&](const auto& figure) {
    double sum = 0;
    size_t count = 0;
    for (const DepthMetrics& image : metrics) {
      if (image.ground_truth_pixels == 0 || std::isnan(figure(image))) continue;
      sum += figure(image);
      ++count;
    }
    return count == 0 ? kNan : sum / count;
  };
  DepthMetrics mean;
  const double pixels = mean_of([](const DepthMetrics& m) { return static_cast<double>(m.ground_truth_pixels); });
  mean.ground_truth_pixels = std::isnan(pixels) ? 0 : static_cast<size_t>(pixels);
  for (size_t i = 0; i < kAbsoluteThresholds.size(); ++i) {
    mean.below_absolute[i] = mean_of([i](const DepthMetrics& m) { return m.below_absolute[i]; });
    mean.below_relative[i] = mean_of([i](const DepthMetrics& m) { return m.below_relative[i]; });
  }
  mean.density = mean_of([](const DepthMetrics& m) { return m.density; });
  mean.median_error = mean_of([](const DepthMetrics& m) { return m.median_error; });
  return mean;
}

}  // namespace acmp
