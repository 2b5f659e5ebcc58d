#include "acmp_mapping/ros/latency_window.h"

#include <algorithm>

namespace acmp {

void LatencyWindow::Add(double latency_ms) {
  if (latencies_ms_.size() < kCapacity) {
    latencies_ms_.push_back(latency_ms);
  } else {
    latencies_ms_[count_ % kCapacity] = latency_ms;
  }
  ++count_;
}

LatencyWindow::Quantiles LatencyWindow::quantiles() const {
  if (latencies_ms_.empty()) return {};
  std::vector<double> sorted = latencies_ms_;
  std::sort(sorted.begin(), sorted.end());
  const size_t last = sorted.size() - 1;
  return {count_, sorted[last / 2], sorted[last * 99 / 100], sorted[last]};
}

}  // namespace acmp
