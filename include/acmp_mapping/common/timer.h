#pragma once

#include <chrono>

namespace acmp {

/// Wall clock for reports; nothing is decided by it.
class Timer {
 public:
  /// Milliseconds since construction or the last Lap, and starts anew.
  double Lap() {
    const double elapsed = Elapsed();
    start_ += std::chrono::duration_cast<std::chrono::steady_clock::duration>(
        std::chrono::duration<double, std::milli>(elapsed));
    return elapsed;
  }

  /// The same without starting anew.
  double Elapsed() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace acmp
