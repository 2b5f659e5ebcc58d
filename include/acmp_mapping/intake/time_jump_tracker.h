#pragma once

#include <cstdint>
#include <optional>

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

}  // namespace acmp
