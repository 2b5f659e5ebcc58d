#pragma once

#include <array>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace acmp {

/// Where lanes that share work, each in a thread of its own, exchange what they have, as those of a warp do.
template <class T, int kLanes>
class MeetingPoint {
 public:
  /// Blocks until all lanes have come. What each has brought, by rank.
  std::array<T, kLanes> Meet(int rank, const T& brought) {
    std::unique_lock<std::mutex> lock(mutex_);
    const long round = round_;
    brought_[static_cast<size_t>(rank)] = brought;
    if (++present_ == kLanes) {
      shared_ = brought_;
      present_ = 0;
      ++round_;
      all_present_.notify_all();
    } else {
      all_present_.wait(lock, [&] { return round_ != round; });
    }
    return shared_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable all_present_;
  std::array<T, kLanes> brought_ = {}, shared_ = {};
  int present_ = 0;
  long round_ = 0;
};

/// Calls lane(rank) for all ranks at the same time.
template <class Lane>
void OnLaneThreads(int lanes, const Lane& lane) {
  std::vector<std::thread> threads;
  threads.reserve(static_cast<size_t>(lanes));
  for (int rank = 0; rank < lanes; ++rank) threads.emplace_back([&lane, rank] { lane(rank); });
  for (std::thread& thread : threads) thread.join();
}

}  // namespace acmp
