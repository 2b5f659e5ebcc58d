#include "acmp_mapping/intake/stream_buffers.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <utility>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

std::string FormatStamp(int64_t stamp_ns) {
  constexpr int64_t kNsPerS = 1000000000;
  char text[40];
  std::snprintf(text, sizeof(text), "%" PRId64 ".%09" PRId64, stamp_ns / kNsPerS, stamp_ns % kNsPerS);
  return text;
}

bool TimeJumpTracker::Add(int64_t stamp_ns, uint64_t arrival) {
  const int64_t before_ns = std::max(newest_ns_, left_newest_ns_.value_or(INT64_MIN));
  if (before_ns != INT64_MIN && stamp_ns < before_ns - kTimeJumpNs) {
    const bool follows_images = is_behind();
    left_newest_ns_.reset();
    newest_ns_ = stamp_ns;
    if (!follows_images) jump_ = Jump{before_ns, arrival};
    return follows_images;
  }
  newest_ns_ = std::max(newest_ns_, stamp_ns);
  // Beyond where it was without the images having gone back: a message that came late, or poses that were sent again. A
  // short bag that loops may bring all of a stream before the first image, up to the very stamp.
  if (jump_ && newest_ns_ > jump_->from_ns) jump_.reset();
  return false;
}

std::optional<uint64_t> TimeJumpTracker::StartRun(int64_t first_ns) {
  left_newest_ns_.reset();
  if (const auto jump = std::exchange(jump_, std::nullopt)) return jump->arrival;
  // A stream that had not got so far goes on without a jump.
  if (newest_ns_ != INT64_MIN && newest_ns_ - kTimeJumpNs > first_ns) left_newest_ns_ = newest_ns_;
  newest_ns_ = INT64_MIN;
  return std::nullopt;
}

}  // namespace acmp
