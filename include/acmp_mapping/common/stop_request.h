#pragma once

#include <tbb/parallel_for.h>

#include <atomic>
#include <exception>
#include <mutex>

namespace acmp {

/// Thrown where a run stops because the user asked for it. No std::exception on purpose: nothing on the way up may take
/// it for a failure of one image and go on.
struct Interrupted {};

/// Makes a quick, orderly stop: after Request, which any thread may call, parallel loops that run inside RunCancellable
/// are cancelled, and the next Check throws. What a cancelled loop left behind is unfinished, so Check must come before
/// any result is kept.
class StopRequest {
 public:
  StopRequest() = default;
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;

  void Request() {
    const std::lock_guard<std::mutex> lock(mutex_);
    requested_ = true;  // first: whoever finds its loops cancelled must also find this set
    context_.cancel_group_execution();
  }
  /// As if nobody had asked. Nothing may run inside RunCancellable.
  void Clear() {
    const std::lock_guard<std::mutex> lock(mutex_);
    context_.reset();
    requested_ = false;
  }

  bool requested() const { return requested_; }
  void Check() const {
    if (requested_) throw Interrupted();
  }

  /// Runs `work` in this thread and throws what it throws, unless a stop was asked for meanwhile: what cancelled loops
  /// leave may look like any error. Does nothing once a stop was asked for. Check comes after it.
  template <class Work>
  void RunCancellable(const Work& work) {
    // A loop of one turn, as a task_group of TBB 2020 takes no context. Its context is cancelled by exceptions too: not
    // by those of `work`.
    std::exception_ptr thrown;
    const auto once = [&](int) {
      try {
        work();
      } catch (...) {
        thrown = std::current_exception();
      }
    };
    // Inside another loop: TBB 2020 does not cancel what runs in a loop that a thread begins outside of any other.
    const auto cancellable = [&](int) { tbb::parallel_for(0, 1, once, tbb::simple_partitioner(), context_); };
    tbb::parallel_for(0, 1, cancellable, tbb::simple_partitioner());
    if (thrown && !requested_) std::rethrow_exception(thrown);
  }

 private:
  std::mutex mutex_;  ///< of Request and Clear
  std::atomic<bool> requested_{false};
  tbb::task_group_context context_{tbb::task_group_context::isolated};
};

}  // namespace acmp
