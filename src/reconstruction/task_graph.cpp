#include "task_graph.h"

#include <thread>

#include "acmp_mapping/common/error.h"

namespace acmp {

int TaskGraph::Add(int pool, int rank, const std::vector<int>& after, std::function<void(int)> work) {
  const int number = static_cast<int>(tasks_.size());
  for (int other : after) {
    CheckRange("number of a task that another waits for", other, 0, number - 1);
    tasks_[static_cast<size_t>(other)].followers.push_back(number);
  }
  tasks_.push_back({static_cast<size_t>(pool), rank, static_cast<int>(after.size()), {}, std::move(work)});
  return number;
}

void TaskGraph::Run(const std::vector<int>& threads, const StopRequest& interrupt) {
  ready_.resize(threads.empty() ? 1 : threads.size());
  left_ = tasks_.size();
  for (size_t i = 0; i < tasks_.size(); ++i) {
    if (threads.empty()) tasks_[i].pool = 0;
    if (tasks_[i].waits_for == 0) MakeReady(static_cast<int>(i));
  }
  std::vector<std::thread> workers;
  try {
    for (size_t pool = 0; pool < threads.size(); ++pool) {
      for (int i = 0; i < threads[pool]; ++i) workers.emplace_back([=, &interrupt] { Work(pool, i, interrupt); });
    }
  } catch (...) {
    // The system gives no further thread. Those that run must be joined before the error may leave.
    Fail(std::current_exception());
  }
  if (threads.empty()) Work(0, 0, interrupt);
  for (std::thread& worker : workers) worker.join();
  if (failure_) std::rethrow_exception(failure_);
}

void TaskGraph::Work(size_t pool, int thread, const StopRequest& interrupt) {
  for (int number = Next(pool); number >= 0; number = Next(pool)) {
    try {
      interrupt.Check();
      std::function<void(int)> work = std::move(tasks_[static_cast<size_t>(number)].work);
      work(thread);
      interrupt.Check();
      work = nullptr;  // what it holds goes before others go on, and not under the mutex
      Finish(number);
    } catch (...) {
      Fail(std::current_exception());
    }
  }
}

void TaskGraph::MakeReady(int number) {
  const Task& task = tasks_[static_cast<size_t>(number)];
  ready_.at(task.pool).insert({task.rank, number});
}

/// A ready task of the pool; waits for one. -1: there will be none any more.
int TaskGraph::Next(size_t pool) {
  std::unique_lock<std::mutex> lock(mutex_);
  auto& ready = ready_[pool];
  changed_.wait(lock, [&] { return failure_ || left_ == 0 || !ready.empty(); });
  if (failure_ || ready.empty()) return -1;
  const int number = ready.begin()->second;
  ready.erase(ready.begin());
  return number;
}

void TaskGraph::Finish(int number) {
  const std::lock_guard<std::mutex> lock(mutex_);
  --left_;
  for (int follower : tasks_[static_cast<size_t>(number)].followers) {
    if (--tasks_[static_cast<size_t>(follower)].waits_for == 0) MakeReady(follower);
  }
  changed_.notify_all();
}

/// No further task is begun.
void TaskGraph::Fail(std::exception_ptr failure) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!failure_) failure_ = std::move(failure);
  changed_.notify_all();
}

}  // namespace acmp
