#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

#include "acmp_mapping/ros/input_sources.h"

namespace acmp {

/// When something that is made of the whole map is to be published: when somebody listens, the map or the listeners
/// have changed, and the last time is long enough ago. Request may be called in any thread, the rest belongs to one.
class PublishPace {
 public:
  /// A new listener: publish even if nothing has changed.
  void Request() { requested_ = true; }

  /// @param max_rate Hz; 0: never
  bool IsDue(double max_rate, uint32_t listeners, uint64_t map_version) const {
    if (max_rate <= 0 || SteadySeconds() < next_s_ || listeners == 0) return false;
    return map_version != published_version_ || requested_;
  }

  /// First, before the map is read, also where nothing comes of it.
  void Begin(uint64_t map_version) {
    begun_s_ = SteadySeconds();
    requested_ = false;
    published_version_ = map_version;
  }

  /// When it has been published, or failed.
  void End(double max_rate) {
    const double now_s = SteadySeconds();
    next_s_ = now_s + std::max(1 / max_rate, (1 + kLoad) * (now_s - begun_s_));
  }

 private:
  static constexpr double kLoad = 4;  ///< takes at most one part in 1 + kLoad of a core

  std::atomic<bool> requested_{false};
  uint64_t published_version_ = 0;
  double begun_s_ = 0, next_s_ = 0;
};

}  // namespace acmp
