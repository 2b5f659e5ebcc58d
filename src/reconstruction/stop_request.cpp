#include "acmp_mapping/reconstruction/stop_request.h"

#include <unistd.h>

namespace acmp {

InterruptWatcher::InterruptWatcher() {
  sigemptyset(&signals_);
  for (int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
  pthread_sigmask(SIG_BLOCK, &signals_, &previous_signals_);
  watcher_ = std::thread([this] { Watch(); });
}

InterruptWatcher::~InterruptWatcher() {
  stopping_ = true;
  pthread_kill(watcher_.native_handle(), SIGINT);  // for that thread alone, which takes it and ends
  watcher_.join();
  pthread_sigmask(SIG_SETMASK, &previous_signals_, nullptr);
}

void InterruptWatcher::Watch() {
  for (int signal = 0; sigwait(&signals_, &signal) == 0 && !stopping_;) {
    if (requested()) {
      // Files are whole or absent at any time, so stopping dead loses nothing but the step at hand.
      static const char kMessage[] = "\nstopped at once\n";
      [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, kMessage, sizeof(kMessage) - 1);
      _exit(1);
    }
    static const char kMessage[] = "\nstopping (press Ctrl-C again to stop at once) ...\n";
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, kMessage, sizeof(kMessage) - 1);
    Request();
  }
}

}  // namespace acmp
