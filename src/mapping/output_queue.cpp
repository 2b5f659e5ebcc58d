#include "output_queue.h"

#include <utility>

namespace acmp {

OutputQueue::OutputQueue(bool has_thread) {
  if (has_thread) thread_ = std::thread([this] { Run(); });
}

OutputQueue::~OutputQueue() {
  std::deque<Job> discarded;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
    discarded.swap(jobs_);
  }
  discarded.clear();  // without the lock: jobs may own anything
  given_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void OutputQueue::Submit(Job job) {
  if (!thread_.joinable()) return job();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(std::move(job));
    ++unfinished_;
  }
  given_.notify_one();
  WaitForFewerThan(kMaxJobs);
}

void OutputQueue::WaitForAll() { WaitForFewerThan(1); }

void OutputQueue::WaitForFewerThan(size_t jobs) {
  std::unique_lock<std::mutex> lock(mutex_);
  done_.wait(lock, [&] { return unfinished_ < jobs; });
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void OutputQueue::Run() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    given_.wait(lock, [this] { return stopped_ || !jobs_.empty(); });
    if (stopped_) return;
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    std::exception_ptr failure;
    try {
      job();
    } catch (...) {
      failure = std::current_exception();
    }
    job = nullptr;  // what it holds goes before its giver hears that it is done
    lock.lock();
    if (!failure_) failure_ = failure;
    --unfinished_;
    done_.notify_one();
  }
}

}  // namespace acmp
