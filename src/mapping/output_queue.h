#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace acmp {

/// Runs jobs one after the other in the order they were given: at once, or in a thread of its own. One thread gives
/// them.
class OutputQueue {
 public:
  using Job = std::function<void()>;

  explicit OutputQueue(bool has_thread);
  /// Waits for the job under way; those after it are thrown away.
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  /// Waits while kMaxJobs have not been done. What a job throws comes out here or in a later call of either method;
  /// jobs after it are run all the same.
  void Submit(Job job);

  void WaitForAll();

  /// Each holds maps on the device; a few let the two threads go on while one of them has more to do than usual.
  static constexpr size_t kMaxJobs = 4;

 private:
  void Run();
  /// Until fewer jobs than these are not done.
  void WaitForFewerThan(size_t jobs);

  std::mutex mutex_;  ///< of all that follows
  std::condition_variable given_, done_;
  std::deque<Job> jobs_;        ///< that have not begun
  size_t unfinished_ = 0;       ///< these and the one under way
  std::exception_ptr failure_;  ///< of the first job that has thrown since this was last told
  bool stopped_ = false;
  std::thread thread_;  ///< last: it starts when everything above exists
};

}  // namespace acmp
