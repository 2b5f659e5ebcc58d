#include "acmp_mapping/ros/keyframe_sequence.h"

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/keyframe_numbers.h"
#include "acmp_mapping/ros/sensor_samples.h"

namespace acmp {

using acmp_mapping::KeyframePointsConstPtr;

KeyframeSequence::Result KeyframeSequence::Add(KeyframePointsConstPtr keyframe) {
  Result result;
  const uint64_t number = keyframe->number;
  const auto twice = std::find_if(seen_.begin(), seen_.end(), [&](const Seen& seen) {
    return seen.number == number || seen.stamp == keyframe->header.stamp;
  });
  if (twice != seen_.end()) {
    result.drops.push_back(
        {"keyframe_twice",
         Concat("keyframe ", FormatStamp(static_cast<int64_t>(keyframe->header.stamp.toNSec())), ", number ", number,
                ", of shard ", keyframe->shard_index, " has come already, as number ", twice->number,
                ": two shards have the same ~shard_index, or do not agree on the numbers")});
    return result;
  }
  // Recordings that loop repeat their stamps.
  seen_.push_back({number, keyframe->header.stamp});
  if (seen_.size() > KeyframeNumbers::kCorrectable) seen_.pop_front();

  if (started_ && number < next_) {
    if (missing_ > 0) --missing_;
    result.keyframes.push_back(std::move(keyframe));
    return result;
  }
  if (number == 0) started_ = true;
  held_.emplace(number, std::move(keyframe));
  if (started_) ReleaseReady(&result);
  if (held_.size() > kMaxHeld) {
    ReleaseTo(held_.begin()->first, &result);
    ReleaseReady(&result);
  }
  return result;
}

KeyframeSequence::Result KeyframeSequence::GiveUp() {
  Result result;
  while (!held_.empty()) {
    ReleaseTo(held_.begin()->first, &result);
    ReleaseReady(&result);
  }
  return result;
}

void KeyframeSequence::ReleaseTo(uint64_t number, Result* result) {
  if (started_ && number > next_) {
    missing_ += number - next_;
    result->drops.push_back({"keyframe_missing", Concat(number - next_, " keyframes from number ", next_,
                                                        " on have neither come nor been dropped by any shard")});
  }
  started_ = true;
  next_ = number;
}

void KeyframeSequence::ReleaseReady(Result* result) {
  while (!held_.empty() && held_.begin()->first == next_) {
    result->keyframes.push_back(std::move(held_.begin()->second));
    held_.erase(held_.begin());
    ++next_;
  }
}

}  // namespace acmp
