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

/// Of a run's messages. @param log_is_terminal where they go
inline ProgressStyle ProgressStyleFor(bool quiet, bool log_is_terminal) {
  if (quiet) return ProgressStyle::kSilent;
  return log_is_terminal ? ProgressStyle::kBar : ProgressStyle::kLines;
}

/// Reports how far a stage of a run is, with the time left. For any number of threads.
class Progress {
 public:
  /// @param stream not null; outlives this
  Progress(std::ostream* stream, ProgressStyle style);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Begins a stage of `steps` steps of the same cost. @param reused an earlier run did so many of them
  void Begin(const std::string& stage, int steps, int reused = 0);
  void Step();  ///< is done
  /// A line for the user, above the bar; silent runs leave it out unless it is a warning.
  void Note(const std::string& message);
  void Warn(const std::string& message);

  /// Of the stage, from the steps done in this run; negative while unknown.
  /// @param elapsed_s since it began
  double SecondsLeft(double elapsed_s) const;

 private:
  void Show();
  void EraseBar();

  std::mutex mutex_;
  std::ostream* stream_;
  ProgressStyle style_;
  std::chrono::steady_clock::time_point start_;
  std::string stage_;
  int steps_ = 0, step_ = 0, reused_ = 0;
  int shown_percent_ = -1;
  bool bar_visible_ = false;
};

/// "1:05:09", "2:07", "0:04".
std::string FormatDuration(double seconds);

}  // namespace acmp
