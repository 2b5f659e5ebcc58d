#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/common/stop_request.h"

namespace acmp {

/// Tasks that wait for others, done by several threads.
class TaskGraph {
 public:
  /// Adds a task and returns its number. It runs once the tasks `after`, of smaller numbers, are done.
  /// @param pool which threads do it
  /// @param rank of those that are ready a pool takes the least rank first, and then the smallest number
  /// @param work is told the number of its thread in the pool
  int Add(int pool, int rank, const std::vector<int>& after, std::function<void(int)> work);

  /// Does all tasks with threads[p] threads, at least one, for pool p. No pools: the caller's own thread does all, in
  /// the same order. Throws what a task threw first, or Interrupted, or std::system_error where a thread cannot be
  /// started, when all threads have stopped. Once per graph.
  void Run(const std::vector<int>& threads, const StopRequest& interrupt);

 private:
  struct Task {
    size_t pool = 0;
    int rank = 0;
    int waits_for = 0;  ///< tasks that are not done
    std::vector<int> followers;
    std::function<void(int)> work;
  };

  void Work(size_t pool, int thread, const StopRequest& interrupt);
  void MakeReady(int number);
  int Next(size_t pool);
  void Finish(int number);
  void Fail(std::exception_ptr failure);

  std::vector<Task> tasks_;

  std::mutex mutex_;  ///< of all below, and of waits_for
  std::condition_variable changed_;
  std::vector<std::set<std::pair<int, int>>> ready_;  ///< rank and number, per pool
  size_t left_ = 0;                                   ///< tasks
  std::exception_ptr failure_;
};

}  // namespace acmp
