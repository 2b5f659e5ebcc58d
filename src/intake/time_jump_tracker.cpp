#include "acmp_mapping/intake/time_jump_tracker.h"

#include <algorithm>
#include <utility>

namespace acmp {

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
  // The stream is where it was before its jump, and the images have not gone back: it was no jump, but a late message
  // or poses that were sent again. Reaching the same stamp is not enough: of a short bag that loops, all of a stream
  // may come before the first image.
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
