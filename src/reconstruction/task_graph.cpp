#include "task_graph.h"

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <set>
#include <thread>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr int kMaxThreads = 65536;  // of a pool: far more than any system gives, and sums stay small

}  // namespace

int TaskGraph::Add(int pool, const std::vector<int>& after, std::function<void(int)> work, bool urgent) {
  const int number = static_cast<int>(tasks_.size());
  for (int other : after) {
    CheckRange("number of a task that another waits for", other, 0, number - 1);
    tasks_[static_cast<size_t>(other)].followers.push_back(number);
  }
  tasks_.push_back({pool, static_cast<int>(after.size()), {}, std::move(work), urgent});
  return number;
}

/// What the threads share while the graph runs.
class TaskGraph::Runner {
 public:
  Runner(std::vector<Task>* tasks, size_t pools, const StopRequest& interrupt)
      : tasks_(*tasks), interrupt_(interrupt), ready_(pools), left_(tasks->size()) {
    for (size_t i = 0; i < tasks_.size(); ++i) {
      if (tasks_[i].waits_for == 0) MakeReady(static_cast<int>(i));
    }
  }

  void Work(int pool, int thread) {
    for (int number = Next(pool); number >= 0; number = Next(pool)) {
      try {
        interrupt_.Check();
        std::function<void(int)> work = std::move(tasks_[static_cast<size_t>(number)].work);
        work(thread);
        interrupt_.Check();
        work = nullptr;  // what it holds goes before others go on, and not under the mutex
        Finish(number);
      } catch (...) {
        Fail(std::current_exception());
      }
    }
  }

  /// No further task is begun.
  void Fail(std::exception_ptr failure) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!failure_) failure_ = std::move(failure);
    changed_.notify_all();
  }

  void RethrowFailure() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  using ReadyTasks = std::set<std::pair<bool, int>>;  ///< not urgent, number: the first goes first

  void MakeReady(int number) {
    const Task& task = tasks_[static_cast<size_t>(number)];
    ready_[static_cast<size_t>(task.pool)].insert({!task.urgent, number});
  }

  /// A ready task of the pool; waits for one. -1: there will be none any more.
  int Next(int pool) {
    std::unique_lock<std::mutex> lock(mutex_);
    ReadyTasks& ready = ready_[static_cast<size_t>(pool)];
    changed_.wait(lock, [&] { return failure_ || left_ == 0 || !ready.empty(); });
    if (failure_ || ready.empty()) return -1;
    const int number = ready.begin()->second;
    ready.erase(ready.begin());
    return number;
  }

  void Finish(int number) {
    const std::lock_guard<std::mutex> lock(mutex_);
    --left_;
    for (int follower : tasks_[static_cast<size_t>(number)].followers) {
      Task& task = tasks_[static_cast<size_t>(follower)];
      if (--task.waits_for == 0) MakeReady(follower);
    }
    changed_.notify_all();
  }

  std::vector<Task>& tasks_;
  const StopRequest& interrupt_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ReadyTasks> ready_;  ///< per pool
  size_t left_;
  std::exception_ptr failure_;
};

void TaskGraph::Run(const std::vector<int>& threads, const StopRequest& interrupt) {
  int total = 0;
  for (int count : threads) {
    CheckRange("threads of a pool", count, 0, kMaxThreads);
    total += count;
  }
  if (total == 0) {
    for (Task& task : tasks_) task.pool = 0;
    Runner runner(&tasks_, 1, interrupt);
    runner.Work(0, 0);
    return runner.RethrowFailure();
  }
  for (const Task& task : tasks_) {
    CheckRange("pool of a task", task.pool, 0, static_cast<int>(threads.size()) - 1);
    if (threads[static_cast<size_t>(task.pool)] == 0) {
      throw InvalidInputError(Concat("pool = ", task.pool, ": has tasks but no threads"));
    }
  }
  Runner runner(&tasks_, threads.size(), interrupt);
  std::vector<std::thread> workers;
  try {
    for (size_t pool = 0; pool < threads.size(); ++pool) {
      for (int i = 0; i < threads[pool]; ++i) {
        workers.emplace_back([&runner, pool, i] { runner.Work(static_cast<int>(pool), i); });
      }
    }
  } catch (...) {
    // The system gives no further thread. Those that run must be joined before the error may leave.
    runner.Fail(std::current_exception());
  }
  for (std::thread& worker : workers) worker.join();
  runner.RethrowFailure();
}

}  // namespace acmp
