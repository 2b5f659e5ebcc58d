#include "acmp_mapping/ros/keyframe_numbers.h"

#include <algorithm>
#include <iterator>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/sensor_samples.h"

namespace acmp {
namespace {

constexpr size_t kKept = 1000;  ///< keyframes; peers are behind or ahead by some windows at most

}  // namespace

int64_t KeyframeNumbers::Assign(int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto here = std::find_if(ahead_.begin(), ahead_.end(),
                                 [&](const auto& number_and_stamp) { return number_and_stamp.second == stamp_ns; });
  if (here != ahead_.end()) next_ = std::max(next_, here->first);
  for (auto other = ahead_.find(next_); other != ahead_.end() && other->second != stamp_ns;) {
    other = ahead_.find(++next_);
  }
  ahead_.erase(ahead_.begin(), ahead_.upper_bound(next_));
  entries_.push_back({stamp_ns, next_, next_});
  if (entries_.size() > kKept) entries_.pop_front();
  return next_++;
}

std::string KeyframeNumbers::Compare(int64_t number, int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(mutex_);
  const size_t checked = std::min(entries_.size(), kCorrectable);
  const auto recent = entries_.end() - static_cast<std::ptrdiff_t>(checked);
  const auto same_stamp =
      std::find_if(recent, entries_.end(), [&](const Entry& entry) { return entry.stamp_ns == stamp_ns; });
  if (same_stamp != entries_.end() && same_stamp->number != number) {
    const int64_t behind = number - same_stamp->correct;
    if (behind > 0) {
      for (auto entry = same_stamp; entry != entries_.end(); ++entry) entry->correct += behind;
      next_ += behind;
    }
    return Concat("keyframe ", FormatStamp(stamp_ns), " has the number ", number, " there and ", same_stamp->number,
                  " here");
  }
  const auto same_number =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.number == number; });
  if (same_number != entries_.end() && same_number->stamp_ns != stamp_ns) {
    return Concat("number ", number, " is keyframe ", FormatStamp(stamp_ns), " there and ",
                  FormatStamp(same_number->stamp_ns), " here");
  }
  if (number >= next_) ahead_[number] = stamp_ns;
  if (ahead_.size() > kKept) ahead_.erase(std::prev(ahead_.end()));
  return "";
}

}  // namespace acmp
