#pragma once

#include <functional>
#include <vector>

#include "acmp_mapping/reconstruction/stop_request.h"

namespace acmp {

/// Tasks that wait for others, done by several threads.
class TaskGraph {
 public:
  /// Adds a task and returns its number. It runs once the tasks `after`, of smaller numbers, are done.
  /// @param pool which threads do it
  /// @param work is told the number of its thread in the pool
  /// @param urgent goes before all that are not
  int Add(int pool, const std::vector<int>& after, std::function<void(int)> work, bool urgent = false);

  /// Does all tasks with threads[p] threads for pool p; of those that are ready a pool takes the urgent ones first, and
  /// then the smallest number.
  /// No threads: the caller's own does all, in the same order. Throws what a task threw first, or Interrupted, or
  /// std::system_error where a thread cannot be started, when all threads have stopped. Throws InvalidInputError, with
  /// nothing done, for a task of a pool without threads. Once per graph.
  void Run(const std::vector<int>& threads, const StopRequest& interrupt);

 private:
  struct Task {
    int pool = 0;
    int waits_for = 0;  ///< tasks that are not done
    std::vector<int> followers;
    std::function<void(int)> work;
    bool urgent = false;
  };
  class Runner;

  std::vector<Task> tasks_;
};

}  // namespace acmp
