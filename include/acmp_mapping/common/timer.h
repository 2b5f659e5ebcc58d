#pragma once

#include <chrono>

namespace acmp {

/// Wall clock for reports; nothing is decided by it.
class Timer {
 public:
  /// Milliseconds since construction or the last Lap, and starts anew.
  double Lap() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double, std::milli> elapsed = now - start_;
    start_ = now;
    return elapsed.count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace acmp
