#pragma once

#include <functional>
#include <vector>

#include "reconstruct_interrupt.h"

namespace acmp {

/// Tasks that wait for others, done by several threads.
class TaskGraph {
 public:
  /// Adds a task and returns its number. It runs once the tasks `after`, of smaller numbers, are done.
  /// @param pool which threads do it
  /// @param work is told the number of its thread in the pool
  int Add(int pool, const std::vector<int>& after, std::function<void(int)> work);

  /// Does all tasks with threads[p] threads for pool p; of those that are ready a pool takes the smallest number first.
  /// A single thread for all pools is the caller's own: tasks then run in the order of their numbers. Throws what a
  /// task threw first, or Interrupted, when all threads have stopped.
  void Run(const std::vector<int>& threads, const InterruptWatcher& interrupt);

 private:
  struct Task {
    int pool = 0;
    int waits_for = 0;  ///< tasks that are not done
    std::vector<int> followers;
    std::function<void(int)> work;
  };
  class Runner;

  std::vector<Task> tasks_;
};

}  // namespace acmp
