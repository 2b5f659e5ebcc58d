#pragma once

#include <oneapi/tbb/task_group.h>
#include <signal.h>

#include <atomic>
#include <thread>

namespace acmp {

/// Thrown where a run stops because the user asked for it. No std::exception on purpose: nothing on the way up may take
/// it for a failure of one image and go on.
struct Interrupted {};

/// Turns SIGINT, SIGTERM and SIGHUP into a quick, orderly stop: parallel loops that run inside RunCancellable are
/// cancelled, and the next Check throws. What a cancelled loop left behind is unfinished, so Check must come before any
/// result is kept. A second signal ends the process at once. Make it before any other thread starts: they inherit the
/// blocked signals.
class InterruptWatcher {
 public:
  InterruptWatcher();
  ~InterruptWatcher();
  InterruptWatcher(const InterruptWatcher&) = delete;
  InterruptWatcher& operator=(const InterruptWatcher&) = delete;

  bool requested() const { return requested_; }
  void Check() const {
    if (requested_) throw Interrupted();
  }

  template <class Work>
  void RunCancellable(const Work& work) {
    tbb::task_group(context_).run_and_wait(work);
  }

  /// What a signal does; for tests.
  void Request();

 private:
  void Watch();

  sigset_t signals_;
  sigset_t previous_signals_;
  std::atomic<bool> requested_{false};
  std::atomic<bool> stopping_{false};
  tbb::task_group_context context_{tbb::task_group_context::isolated};
  std::thread watcher_;
};

}  // namespace acmp
