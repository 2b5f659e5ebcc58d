#pragma once

#include <functional>
#include <map>
#include <set>
#include <vector>

#include "acmp_mapping/common/stop_request.h"

namespace acmp {

/// Keys in an order in which each comes after all that it waits for: of those that may come next the least one.
/// @param after what each key waits for: other keys of the map
template <class Key>
std::vector<Key> InOrder(const std::map<Key, std::vector<Key>>& after) {
  std::map<Key, std::vector<Key>> followers;
  std::map<Key, size_t> waits_for;  // keys that have not come yet
  std::set<Key> ready;
  for (const auto& [key, others] : after) {
    waits_for[key] = others.size();
    if (others.empty()) ready.insert(key);
    for (const Key& other : others) followers[other].push_back(key);
  }
  std::vector<Key> order;
  while (!ready.empty()) {
    order.push_back(*ready.begin());
    ready.erase(ready.begin());
    for (const Key& follower : followers[order.back()]) {
      if (--waits_for[follower] == 0) ready.insert(follower);
    }
  }
  return order;
}

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
