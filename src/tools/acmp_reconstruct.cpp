// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

#include <poll.h>
#include <signal.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <iostream>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "tool_main.h"

namespace {

/// SIGINT, SIGTERM and SIGHUP request the stop. A second signal ends the process at once. Make it before any other
/// thread starts: they inherit the blocked signals.
class InterruptWatcher : public acmp::StopRequest {
 public:
  InterruptWatcher() {
    sigemptyset(&signals_);
    for (int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, &previous_signals_);
    watcher_ = std::thread([this] { Watch(); });
  }
  ~InterruptWatcher() {
    stopping_ = true;
    pthread_kill(watcher_.native_handle(), SIGINT);  // for that thread alone, which takes it and ends
    watcher_.join();
    pthread_sigmask(SIG_SETMASK, &previous_signals_, nullptr);
  }

 private:
  void Watch() {
    for (int signal = 0; sigwait(&signals_, &signal) == 0 && !stopping_;) {
      if (requested()) {
        // Files are whole or absent at any time, so stopping dead loses nothing but the step at hand.
        Say("\nstopped at once\n");
        _exit(1);
      }
      Say("\nstopping (press Ctrl-C again to stop at once) ...\n");
      Request();
    }
  }
  static void Say(std::string_view text) {
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, text.data(), text.size());
  }

  sigset_t signals_, previous_signals_;
  std::atomic<bool> stopping_{false};
  std::thread watcher_;
};

/// Lines of standard input as they come.
class InputLines {
 public:
  explicit InputLines(const acmp::StopRequest* interrupt) : interrupt_(*interrupt) {}

  /// The next line without its end; one at the end of the input need not have one. Nothing at the end, or when it
  /// cannot be read. Throws Interrupted while it waits, InvalidInputError for a line that no stage and images take.
  std::optional<std::string> Next() {
    constexpr int kCheckMs = 200;
    constexpr size_t kMaxLine = 100000;  // characters
    for (;;) {
      if (const size_t end = read_.find('\n'); end != std::string::npos) {
        std::string line = read_.substr(0, end);
        read_.erase(0, end + 1);
        return line;
      }
      if (ended_) {
        if (read_.empty()) return std::nullopt;
        return std::exchange(read_, {});
      }
      if (read_.size() > kMaxLine) {
        throw acmp::InvalidInputError(acmp::Concat("--stages: a line has more than ", kMaxLine,
                                                   " characters: must be STAGE IMAGES, as step_0 0-15, or finish"));
      }
      interrupt_.Check();
      pollfd input = {STDIN_FILENO, POLLIN, 0};
      if (poll(&input, 1, kCheckMs) <= 0) continue;
      std::array<char, 4096> block;
      const ssize_t bytes = read(STDIN_FILENO, block.data(), block.size());
      if (bytes > 0) read_.append(block.data(), static_cast<size_t>(bytes));
      ended_ = bytes <= 0;
    }
  }

 private:
  const acmp::StopRequest& interrupt_;
  std::string read_;  ///< and not handed out
  bool ended_ = false;
};

int RunReconstruct(const acmp::ReconstructOptions& options, InterruptWatcher* interrupt) {
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  const acmp::DeviceMaker make_devices = [&] { return acmp::MakeDevices(options, &std::cerr); };
  const bool is_terminal = isatty(STDERR_FILENO);
  const acmp::RunContext context = {make_devices, *interrupt, std::cout, std::cerr, is_terminal};
  bool all_done = true;
  try {
    interrupt->RunCancellable([&] {
      if (!options.stages) return acmp::Reconstruct(options, context);
      InputLines lines(interrupt);
      all_done = acmp::ReconstructStages(options, context, [&] { return lines.Next(); });
    });
    interrupt->Check();
  } catch (const acmp::Interrupted&) {
    std::cerr << "acmp_reconstruct: interrupted; the same command "
              << (options.online() ? "starts anew" : "goes on from here") << "\n";
    return acmp::kExitFailed;
  }
  return all_done ? acmp::kExitDone : acmp::kExitFailed;
}

int Run(int argc, char** argv) {
  signal(SIGXFSZ, SIG_IGN);  // a file that grows over its limit is then an error like a full disk
  InterruptWatcher interrupt;
  acmp::ReconstructOptions options;
  CLI::App app(
      "Computes depth, normal, cost and confidence maps of images with known poses by planar prior assisted\n"
      "PatchMatch multi-view stereo (ACMP), and fuses them into one point cloud.",
      "acmp_reconstruct");
  acmp::AddReconstructOptions(&app, &options);
  return acmp::RunTool(app, argc, argv, [&] { return RunReconstruct(options, &interrupt); });
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Run(argc, argv);
  } catch (...) {  // before the command line was declared: no memory, no thread
    return acmp::kExitFailed;
  }
}
