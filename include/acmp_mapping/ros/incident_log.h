#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// The text with control characters, and bytes that are no UTF-8, as \xNN: newlines and escape codes that come from the
/// network could forge lines of a log, and command the terminal that shows it.
std::string Printable(const std::string& text);

/// Seconds of a clock that never goes back, whatever ROS time does.
double SteadySeconds();

/// Counts incidents, by reason, and says when it is time to tell: at once for a new reason, then at most every
/// kRepeatS, so that a fault at 30 Hz does not flood the log. Thread-safe; its mutex is held for a moment only.
class IncidentLog {
 public:
  static constexpr double kRepeatS = 5;

  struct Entry {
    uint64_t count = 0;
    std::string last_message;
    double last_time_s = 0;
    double last_told_s = 0;
    uint64_t images = 0;  ///< of the count, what ended an image
  };

  /// True when the message should go to the log now. `now_s` is any clock that never goes back.
  bool Record(const RejectedInput& rejected, double now_s);

  std::map<std::string, Entry> entries() const;

  /// Rejected inputs that ended an image.
  uint64_t images() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  uint64_t images_ = 0;
};

}  // namespace acmp
