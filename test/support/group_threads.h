#pragma once

#include <array>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace acmp {

/// Where the threads of a group exchange what they have, as those of a warp do.
template <class T, int kThreads>
class MeetingPoint {
 public:
  /// Blocks until all have come. What each has brought, by rank.
  std::array<T, kThreads> Meet(int rank, const T& brought) {
    std::unique_lock<std::mutex> lock(mutex_);
    const long round = round_;
    brought_[static_cast<size_t>(rank)] = brought;
    if (++present_ == kThreads) {
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
  std::array<T, kThreads> brought_ = {}, shared_ = {};
  int present_ = 0;
  long round_ = 0;
};

/// Calls work(rank) for all ranks at the same time.
template <class Work>
void OnThreads(int count, const Work& work) {
  std::vector<std::thread> threads;
  threads.reserve(static_cast<size_t>(count));
  for (int rank = 0; rank < count; ++rank) threads.emplace_back([&work, rank] { work(rank); });
  for (std::thread& thread : threads) thread.join();
}

}  // namespace acmp
