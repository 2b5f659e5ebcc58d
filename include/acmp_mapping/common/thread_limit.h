#pragma once

#include <tbb/task_arena.h>

#include <algorithm>

namespace acmp {

/// Runs functions whose parallel loops (TBB) take at most so many threads, for what is done beside other work: a loop
/// wakes all that it may take, and these look for more to do for a while. Used by one thread at a time.
class ThreadLimit {
 public:
  explicit ThreadLimit(int threads) : arena_(std::min(threads, tbb::this_task_arena::max_concurrency())) {}

  template <class Function>
  auto Run(const Function& function) {
    return arena_.execute(function);
  }

 private:
  tbb::task_arena arena_;
};

}  // namespace acmp
