#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace acmp {

/// Finds the best setting that a machine keeps up with (`preset: auto`). It begins with a cheap one, measures on it how
/// long keyframes take and how fast they come, goes to the best one that should need at most half of the time between
/// two keyframes, and measures again there, until it stays. Nothing is assumed of the machine.
class AutoPreset {
 public:
  struct Setting {
    const char* preset;
    double size;           ///< of images, as a share of the largest allowed
    int max_source_views;  ///< at most
    double cost;           ///< time per keyframe as a share of the first one's
  };
  /// Best first.
  static const std::vector<Setting>& Settings();

  size_t index() const { return current_; }  ///< of the current setting
  const Setting& setting() const { return Settings()[current_]; }
  bool is_settled() const { return is_settled_; }
  bool keeps_up() const { return keeps_up_; }  ///< false: even the cheapest takes more of the time

  /// A keyframe was mapped with the current setting.
  /// @param mapping_ms what it took in all
  /// @param interval_s mean time between the newest keyframes by their stamps; none: not known yet
  /// @return when the setting changes or is settled: a sentence that says which, and why
  std::optional<std::string> Add(double mapping_ms, std::optional<double> interval_s);

 private:
  static constexpr size_t kFirst = 3;  ///< half of the size: a keyframe takes a tenth of the best setting's time

  size_t current_ = kFirst;
  std::vector<size_t> tried_ = {kFirst};
  std::vector<double> times_ms_;  ///< of keyframes with the current setting
  bool is_settled_ = false;
  bool keeps_up_ = true;
};

}  // namespace acmp
