#pragma once

#include <chrono>
#include <mutex>
#include <ostream>
#include <string>

namespace acmp {

enum class ProgressStyle {
  kBar,     ///< one line that is redrawn, for a terminal
  kLines,   ///< one plain line per percent, for files and pipes
  kSilent,  ///< warnings only
};

/// Reports how far a run is, with the time left. Work is counted in steps of known relative cost. For any number of
/// threads.
class Progress {
 public:
  /// @param total_cost of all steps of the run
  Progress(std::ostream* stream, ProgressStyle style, double total_cost);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Begins a stage of `steps` steps, each of the given cost.
  void Begin(const std::string& stage, int steps, double cost_per_step);
  /// One step is done. `reused`: an earlier run did it, so it says nothing about the speed.
  void Step(bool reused = false);
  /// A line for the user, above the bar; silent runs leave it out unless it is a warning.
  void Note(const std::string& message);
  void Warn(const std::string& message);

  double done_share() const;
  /// Seconds left, from the cost done in this run; negative while unknown.
  double SecondsLeft(double elapsed_s) const;

 private:
  void Show();
  void EraseBar();

  std::mutex mutex_;
  std::ostream* stream_;
  ProgressStyle style_;
  double total_cost_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::string stage_;
  int steps_ = 0;
  int step_ = 0;
  double cost_per_step_ = 0;
  double done_cost_ = 0;
  double reused_cost_ = 0;
  int shown_percent_ = -1;
  bool bar_visible_ = false;
};

/// "1:05:09", "2:07", "0:04".
std::string FormatDuration(double seconds);

}  // namespace acmp
