#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <vector>

#include <acmp_mapping/KeyframePoints.h>

#include "acmp_mapping/ros/drop.h"

namespace acmp {

/// Brings the keyframes of several shards into the order of their numbers, as one mapper would have finished them, and
/// notices numbers that no shard answers for and keyframes that two do. Not thread-safe.
class KeyframeSequence {
 public:
  static constexpr size_t kMaxHeld = 64;  ///< keyframes that wait for an earlier one

  struct Result {
    std::vector<acmp_mapping::KeyframePointsConstPtr> keyframes;  ///< in order, with points or dropped
    std::vector<Drop> drops;
  };

  /// Those that are complete up to the first missing number. One that comes after its number was given up follows at
  /// once. The first number expected is 0, or after GiveUp the lowest that waits.
  Result Add(acmp_mapping::KeyframePointsConstPtr keyframe);

  /// All that wait, without those missing before them.
  Result GiveUp();

  /// Forgets those that wait.
  void Clear() { held_.clear(); }

  size_t held() const { return held_.size(); }
  uint64_t missing() const { return missing_; }  ///< numbers given up and not come since

 private:
  struct Seen {
    uint64_t number;
    ros::Time stamp;
  };
  void ReleaseTo(uint64_t number, Result* result);
  void ReleaseReady(Result* result);

  std::map<uint64_t, acmp_mapping::KeyframePointsConstPtr> held_;
  std::deque<Seen> seen_;  ///< the latest ones, in order of arrival
  uint64_t next_ = 0;
  bool started_ = false;
  uint64_t missing_ = 0;
};

}  // namespace acmp
