#include "acmp_mapping/intake/companion_images.h"

#include <algorithm>
#include <utility>

#include "run_buffer.h"

namespace acmp {

void CompanionImages::Add(CompanionSample sample, uint64_t arrival, size_t capacity) {
  if (runs_.Add(sample.stamp_ns, arrival)) received_.clear();
  received_.push_back({std::move(sample), arrival});
  if (received_.size() > capacity) received_.pop_front();
}

bool CompanionImages::IsSettled(int64_t stamp_ns, bool is_first) const {
  if (!expected_) return true;
  const int64_t earliest_ns = stamp_ns - kSameExposureNs;
  const bool may_be_old = runs_.is_behind() && is_first;
  const int64_t latest_ns = may_be_old ? stamp_ns + kSameExposureNs : INT64_MAX;
  return std::any_of(received_.begin(), received_.end(), [&](const Received& r) {
    return r.sample.stamp_ns >= earliest_ns && r.sample.stamp_ns <= latest_ns;
  });
}

std::shared_ptr<const EncodedImage> CompanionImages::Find(int64_t stamp_ns) const {
  const auto nearest = std::min_element(received_.begin(), received_.end(), [&](const Received& a, const Received& b) {
    return Gap(a, stamp_ns) < Gap(b, stamp_ns);
  });
  return nearest != received_.end() && Gap(*nearest, stamp_ns) <= kSameExposureNs ? nearest->sample.image : nullptr;
}

void CompanionImages::StartRun(int64_t first_image_ns) { KeepNewRun(first_image_ns, &runs_, &received_); }

void CompanionImages::Clear() {
  received_.clear();
  runs_ = TimeJumpTracker();
}

}  // namespace acmp
