#include "acmp_mapping/intake/stream_buffers.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <utility>

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

void CompanionImages::Add(CompanionSample sample, uint64_t arrival, size_t capacity) {
  if (runs_.Add(sample.stamp_ns, arrival)) received_.clear();
  received_.push_back({std::move(sample), arrival});
  if (received_.size() > capacity) received_.pop_front();
}

bool CompanionImages::IsSettled(int64_t stamp_ns, bool is_first) const {
  if (!expected_) return true;
  const int64_t earliest_ns = stamp_ns - tolerance_ns_;
  const bool may_be_old = runs_.is_behind() && is_first;
  const int64_t latest_ns = may_be_old ? stamp_ns + tolerance_ns_ : INT64_MAX;
  return std::any_of(received_.begin(), received_.end(), [&](const Received& r) {
    return r.sample.stamp_ns >= earliest_ns && r.sample.stamp_ns <= latest_ns;
  });
}

std::shared_ptr<const EncodedImage> CompanionImages::Find(int64_t stamp_ns) const {
  const auto nearest = std::min_element(received_.begin(), received_.end(), [&](const Received& a, const Received& b) {
    return Gap(a, stamp_ns) < Gap(b, stamp_ns);
  });
  return nearest != received_.end() && Gap(*nearest, stamp_ns) <= tolerance_ns_ ? nearest->sample.image : nullptr;
}

void CompanionImages::StartRun(int64_t first_image_ns) { KeepNewRun(first_image_ns, &runs_, &received_); }

void CompanionImages::Clear() {
  received_.clear();
  runs_ = TimeJumpTracker();
}

}  // namespace acmp
