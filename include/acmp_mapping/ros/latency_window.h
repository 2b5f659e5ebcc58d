#pragma once

#include <cstddef>
#include <vector>

namespace acmp {

/// Latencies of the last outputs. Not thread-safe.
class LatencyWindow {
 public:
  static constexpr size_t kCapacity = 1000;

  struct Quantiles {
    size_t count = 0;  ///< outputs since the start, not only those in the window
    double median_ms = 0, p99_ms = 0, max_ms = 0;
  };

  void Add(double latency_ms);
  Quantiles quantiles() const;

 private:
  std::vector<double> latencies_ms_;  ///< a ring once it is full
  size_t count_ = 0;
};

}  // namespace acmp
