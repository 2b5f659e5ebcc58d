#pragma once

#include <condition_variable>
#include <cstdint>
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
  /// @return the job's number, from 1 on
  uint64_t Submit(Job job);

  /// Returns when this job and all before it are done; 0: at once.
  void WaitFor(uint64_t number);
  void WaitForAll() { WaitFor(submitted_); }

  /// Each holds maps on the device; a few let the two threads go on while one of them has more to do than usual.
  static constexpr uint64_t kMaxJobs = 4;

 private:
  void Run();
  void WaitUntilDone(std::unique_lock<std::mutex>* lock, uint64_t number);

  uint64_t submitted_ = 0;  ///< of the giving thread
  std::mutex mutex_;        ///< of all that follows
  std::condition_variable given_, done_;
  std::deque<Job> jobs_;
  uint64_t finished_ = 0;
  std::exception_ptr failure_;  ///< of the first job that has thrown since this was last told
  bool stopped_ = false;
  std::thread thread_;  ///< last: it starts when everything above exists
};

}  // namespace acmp
