#pragma once

#include <chrono>
#include <mutex>
#include <ostream>
#include <string>

namespace acmp {

/// Reports how far a stage of a run is, with the time left. For any number of threads.
class Progress {
 public:
  /// @param log gets all but results, for a terminal a bar that is redrawn, else a line per percent; both outlive this
  /// @param quiet warnings only
  Progress(std::ostream* log, std::ostream* results, bool quiet, bool log_is_terminal)
      : log_(*log), results_(*results), quiet_(quiet), has_bar_(log_is_terminal) {}
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Begins a stage of `steps` steps of the same cost. @param reused an earlier run did so many of them
  void Begin(const std::string& stage, int steps, int reused = 0);
  void Step();  ///< is done
  /// A line for the user, above the bar.
  void Note(const std::string& message);
  void Warn(const std::string& message);  ///< unless it is empty
  void Result(const std::string& message);

  /// Of the stage, from the steps done in this run; negative while unknown.
  /// @param elapsed_s since it began
  double SecondsLeft(double elapsed_s) const;

 private:
  void Show();
  void EraseBar();

  std::mutex mutex_;
  std::ostream &log_, &results_;
  const bool quiet_, has_bar_;
  std::chrono::steady_clock::time_point start_;
  std::string stage_;
  int steps_ = 0, step_ = 0, reused_ = 0;
  int shown_percent_ = -1;
  bool bar_visible_ = false;
};

/// "1:05:09", "2:07", "0:04".
std::string FormatDuration(double seconds);

}  // namespace acmp
