#include "acmp_mapping/mapping/auto_preset.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

/// The first keyframes of a window have few source views, and the first ones on a GPU load its code.
constexpr size_t kWarmUp = 3;
constexpr size_t kMeasured = 5;

/// The rest is for what takes its time now and then: halfway through the window a keyframe is refined again, and
/// keyframes do not come at equal distances.
constexpr double kMaxLoad = 0.5;

}  // namespace

const std::vector<AutoPreset::Setting>& AutoPreset::Settings() {
  // Costs: kernels at 640 x 480 on an H100, all of it and 8 of its multiprocessors; pixels in proportion.
  static const std::vector<Setting> settings = {{"balanced", 1, 10, 1},
                                                {"online", 1, 7, 0.45},
                                                {"online", 0.75, 7, 0.25},
                                                {"online", 0.5, 5, 0.09},
                                                {"online", 0.375, 5, 0.05}};
  return settings;
}

std::optional<std::string> AutoPreset::Add(double mapping_ms, std::optional<double> interval_s) {
  if (is_settled_) return std::nullopt;
  times_ms_.push_back(mapping_ms);
  if (times_ms_.size() < kWarmUp + kMeasured || !interval_s || *interval_s <= 0) return std::nullopt;
  const double measured_s = 1e-3 * Median(std::vector<double>(times_ms_.end() - kMeasured, times_ms_.end()));
  const std::vector<Setting>& all = Settings();
  const double s_per_cost = measured_s / setting().cost;
  const auto fitting = std::find_if(
      all.begin(), all.end(), [&](const Setting& other) { return s_per_cost * other.cost <= kMaxLoad * *interval_s; });
  keeps_up_ = fitting != all.end();
  const size_t best = keeps_up_ ? static_cast<size_t>(fitting - all.begin()) : all.size() - 1;
  // Costs are estimates: where two settings point at each other, the cheaper one is it.
  is_settled_ = std::find(tried_.begin(), tried_.end(), best) != tried_.end();
  if (best > current_ || !is_settled_) current_ = best;
  tried_.push_back(best);
  times_ms_.clear();
  return Concat(setting().preset, ", ", 100 * setting().size, " % of max_image_size, at most ",
                setting().max_source_views, " source views: keyframes come every ", *interval_s, " s and took ",
                measured_s, " s so far", keeps_up_ ? "" : ", which is too long for all of them (~overload)");
}

}  // namespace acmp
