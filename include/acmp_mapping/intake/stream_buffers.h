#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <memory>
#include <optional>

#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// Streams whose stamps go back by less brought them in the wrong order; by more, they belong to another run.
constexpr int64_t kTimeJumpNs = 200000000;

/// Tells the runs of one stream apart. When time jumps back (a bag that loops, a restarted frontend), the stamps of
/// every stream do, but between streams there is no order: a message of the new run may come before the image that
/// shows the jump, and one of the old run after it.
class TimeJumpTracker {
 public:
  /// A message has come, as the `arrival`-th of all streams. Returns whether all earlier ones of this stream belong to
  /// a run that the images have left.
  bool Add(int64_t stamp_ns, uint64_t arrival);

  /// The images' stamps went back, to `first_ns`. Returns the arrival of this stream's first message of the new run, if
  /// that has come.
  std::optional<uint64_t> StartRun(int64_t first_ns);

  /// Whether the images' stamps have gone back and this stream's must and have not yet: what comes may be of the run
  /// before. A stream that is stamped by another clock may stay so.
  bool is_behind() const { return left_newest_ns_.has_value(); }
  /// Newest stamp of the run; INT64_MIN before the first one.
  int64_t newest_ns() const { return newest_ns_; }

 private:
  struct Jump {
    int64_t from_ns = 0;
    uint64_t arrival = 0;  ///< of the first message after it
  };

  int64_t newest_ns_ = INT64_MIN;
  std::optional<Jump> jump_;               ///< this stream's, which the images have not followed
  std::optional<int64_t> left_newest_ns_;  ///< while behind: newest stamp of the run that the images have left
};

constexpr int64_t kSameExposureNs = 1000000;  ///< rounding of stamps stays far below, the shortest frame interval above
constexpr size_t kMoreThanImages = 10;        ///< clouds, masks, depth: those of images that are still to come

/// Distance of a received pose, mask or depth map from a stamp.
template <class Received>
int64_t Gap(const Received& received, int64_t stamp_ns) {
  return std::llabs(received.sample.stamp_ns - stamp_ns);
}

/// Leaves what belongs to the run whose first image has this stamp.
template <class Received>
void KeepNewRun(int64_t first_image_ns, TimeJumpTracker* runs, std::deque<Received>* buffer) {
  const std::optional<uint64_t> first = runs->StartRun(first_image_ns);
  const auto is_old = [&first](const Received& received) { return !first || received.arrival < *first; };
  buffer->erase(std::remove_if(buffer->begin(), buffer->end(), is_old), buffer->end());
}

/// A stream of what belongs to the images of the same stamps, rounding aside: masks, depth from outside, or what
/// another camera has taken at the same time.
class CompanionImages {
 public:
  /// @param tolerance_ns between the stamps of what belongs together
  explicit CompanionImages(int64_t tolerance_ns = kSameExposureNs) : tolerance_ns_(tolerance_ns) {}

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

  int64_t tolerance_ns_;
  bool expected_ = false;
  std::deque<Received> received_;  ///< in order of arrival
  TimeJumpTracker runs_;
};

}  // namespace acmp
