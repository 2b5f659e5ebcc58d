#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace acmp {

/// Counts keyframes, so that shards take every n-th. All shards count the same topics, but one that starts later or
/// misses a message would be off by some for ever: so their counts are compared through the estimates that they
/// exchange, and who is behind skips numbers. (The stamps alone cannot tell whose turn it is without a known rate.)
/// Numbers never go back, whatever stamps do. Thread-safe; its mutex is held for a moment only.
class KeyframeNumbers {
 public:
  /// Keyframes back for which a peer's higher number counts as a correction. Recordings that loop repeat their stamps:
  /// a loop must have more keyframes than that.
  static constexpr size_t kCorrectable = 16;

  /// Number of the next keyframe: the one that a peer ahead has given it, else the next that no peer has given to
  /// another.
  int64_t Assign(int64_t stamp_ns);

  /// Compares with a peer's number of a keyframe. Empty when it is the same or nothing is known of either yet; else
  /// what differs: then the peer's estimate is of another keyframe than the one that has this number here.
  std::string Compare(int64_t number, int64_t stamp_ns);

 private:
  struct Entry {
    int64_t stamp_ns;
    int64_t number;   ///< as assigned
    int64_t correct;  ///< as far as is known now
  };
  mutable std::mutex mutex_;
  std::deque<Entry> entries_;         ///< the latest kKept, in order
  std::map<int64_t, int64_t> ahead_;  ///< stamps by number, of keyframes that peers have had and this shard has not
  int64_t next_ = 0;
};

}  // namespace acmp
