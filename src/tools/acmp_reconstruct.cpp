// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

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

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "tool_main.h"

namespace {

constexpr char kGoesOn[] = "the same command goes on from here\n";

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

  /// While the process waits for its next task, which nothing can interrupt, a signal ends it at once.
  void SetWaiting(bool waiting) {
    waiting_ = waiting;
    Check();  // of a signal that came before
  }

 private:
  void Watch() {
    for (int signal = 0; sigwait(&signals_, &signal) == 0 && !stopping_;) {
      const bool again = requested();
      Request();
      if (waiting_) {
        Say(std::string("acmp_reconstruct: interrupted; ") + kGoesOn);
        _exit(acmp::kExitFailed);
      }
      if (again) {
        // Files are whole or absent at any time, so stopping dead loses nothing but the step at hand.
        Say("\nstopped at once\n");
        _exit(acmp::kExitFailed);
      }
      Say("\nstopping (press Ctrl-C again to stop at once) ...\n");
    }
  }
  static void Say(std::string_view text) {
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, text.data(), text.size());
  }

  sigset_t signals_, previous_signals_;
  std::atomic<bool> stopping_{false}, waiting_{false};
  std::thread watcher_;
};

/// The next line of standard input without its end; nothing at the end, or when it cannot be read. A stop ends the
/// process while it waits. Throws InvalidInputError for a line that no stage and images take.
std::optional<std::string> ReadLine(InterruptWatcher* interrupt) {
  constexpr size_t kMaxLine = 100000;  // characters
  std::array<char, kMaxLine + 1> line;
  interrupt->SetWaiting(true);
  std::cin.getline(line.data(), line.size());
  interrupt->SetWaiting(false);
  if (std::cin.fail() && std::cin.gcount() > 0) {
    throw acmp::InvalidInputError(acmp::Concat("--stages: a line has more than ", kMaxLine,
                                               " characters: must be STAGE IMAGES, as step_0 0-15, or finish"));
  }
  if (!std::cin) return std::nullopt;
  return line.data();
}

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
      all_done = acmp::ReconstructStages(options, context, [&] { return ReadLine(interrupt); });
    });
    interrupt->Check();
  } catch (const acmp::Interrupted&) {
    std::cerr << "acmp_reconstruct: interrupted; " << (options.online() ? "the same command starts anew\n" : kGoesOn);
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
  return acmp::RunTool(app, argc, argv, [&] {
    if (!options.mesh.empty() && !options.mesh.has_parent_path()) options.mesh = options.output / options.mesh;
    return RunReconstruct(options, &interrupt);
  });
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return Run(argc, argv);
  } catch (const std::exception& error) {  // before the command line was declared: no memory, no thread
    std::cerr << "acmp_reconstruct: " << error.what() << '\n';
  } catch (...) {
  }
  return acmp::kExitFailed;
}
