#pragma once

#include <cstddef>
#include <deque>
#include <memory>

#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/intake/time_jump_tracker.h"

namespace acmp {

/// A stream of what belongs to the images of the same stamps, rounding aside: masks, or depth from outside.
class CompanionImages {
 public:
  /// Whether anybody publishes them; if not, no image waits. False at first.
  void set_expected(bool expected) { expected_ = expected; }
  bool expected() const { return expected_; }

  /// @param arrival position among all that InputMatcher has received
  /// @param capacity of those that came first, more are forgotten
  void Add(CompanionSample sample, uint64_t arrival, size_t capacity);

  /// Whether an image needs to wait no longer: its own has come, or one of a later image.
  /// @param is_first of its run: what came late of the run before tells nothing of it
  bool IsSettled(int64_t stamp_ns, bool is_first) const;
  /// That of the image with this stamp; null: none has come.
  std::shared_ptr<const EncodedImage> Find(int64_t stamp_ns) const;

  /// Leaves what belongs to the run whose first image has this stamp.
  void StartRun(int64_t first_image_ns);
  void Clear();

 private:
  struct Received {
    CompanionSample sample;
    uint64_t arrival = 0;
  };

  bool expected_ = false;
  std::deque<Received> received_;  ///< in order of arrival
  TimeJumpTracker runs_;
};

}  // namespace acmp
