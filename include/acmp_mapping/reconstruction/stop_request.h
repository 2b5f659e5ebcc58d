#pragma once

#include <signal.h>

#include <atomic>
#include <thread>

#include "acmp_mapping/common/stop_request.h"

namespace acmp {

/// SIGINT, SIGTERM and SIGHUP request the stop. A second signal ends the process at once. Make it before any other
/// thread starts: they inherit the blocked signals.
class InterruptWatcher : public StopRequest {
 public:
  InterruptWatcher();
  ~InterruptWatcher();

 private:
  void Watch();

  sigset_t signals_;
  sigset_t previous_signals_;
  std::atomic<bool> stopping_{false};
  std::thread watcher_;
};

}  // namespace acmp
