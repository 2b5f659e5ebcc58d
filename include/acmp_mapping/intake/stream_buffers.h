#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <optional>
#include <utility>

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

/// What has come of one stream, in order of arrival: poses, clouds, masks, images of other cameras.
template <class Sample>
struct StreamBuffer {
  struct Received {
    int64_t stamp_ns;
    Sample sample;
    uint64_t arrival;   ///< position among all that InputMatcher has received
    bool used = false;  ///< a pose belongs to one image
  };

  /// @param capacity of those that came first, more are forgotten
  void Add(int64_t stamp_ns, Sample sample, uint64_t arrival, size_t capacity) {
    if (runs.Add(stamp_ns, arrival)) received.clear();
    received.push_back({stamp_ns, std::move(sample), arrival});
    if (received.size() > capacity) received.pop_front();
  }

  /// Whether one of these stamps or a later one has come.
  /// @param latest_ns holds for the first image of a run: what came late of the run before tells nothing of it
  bool HasComeFrom(int64_t earliest_ns, int64_t latest_ns, bool is_first) const {
    if (!(is_first && runs.is_behind())) latest_ns = INT64_MAX;
    return std::any_of(received.begin(), received.end(),
                       [&](const Received& r) { return r.stamp_ns >= earliest_ns && r.stamp_ns <= latest_ns; });
  }

  /// Leaves what belongs to the run whose first image has this stamp.
  void StartRun(int64_t first_image_ns) {
    const std::optional<uint64_t> first = runs.StartRun(first_image_ns);
    const auto is_old = [&first](const Received& r) { return !first || r.arrival < *first; };
    received.erase(std::remove_if(received.begin(), received.end(), is_old), received.end());
  }

  std::deque<Received> received;
  TimeJumpTracker runs;
};

/// The received one whose stamp is nearest, of all or of those that are not used; null: none.
template <class Received>
auto Nearest(Received& received, int64_t stamp_ns, bool unused = false) -> decltype(&received.front()) {
  decltype(&received.front()) nearest = nullptr;
  const auto gap = [&](const auto& r) { return std::llabs(r.stamp_ns - stamp_ns); };
  for (auto& one : received) {
    if (!(unused && one.used) && (!nearest || gap(one) < gap(*nearest))) nearest = &one;
  }
  return nearest;
}

}  // namespace acmp
