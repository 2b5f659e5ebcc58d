// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

#include <signal.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <iostream>
#include <optional>

#include "acmp_mapping/reconstruction/interrupt_watcher.h"
#include "acmp_mapping/reconstruction/make_devices.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "input_lines.h"
#include "tool_main.h"

namespace {

int RunReconstruct(const acmp::ReconstructOptions& options, acmp::InterruptWatcher* interrupt) {
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  const acmp::DeviceMaker make_devices = [&] { return acmp::MakeDevices(options, &std::cerr); };
  const bool is_terminal = isatty(STDERR_FILENO);
  bool all_done = true;
  try {
    interrupt->RunCancellable([&] {
      if (options.stages) {
        acmp::InputLines lines(interrupt);
        all_done = acmp::ReconstructStages(
            options, make_devices, interrupt, [&] { return lines.Next(); }, &std::cout, &std::cerr, is_terminal);
      } else {
        acmp::Reconstruct(options, make_devices, interrupt, &std::cout, &std::cerr, is_terminal);
      }
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
  acmp::InterruptWatcher interrupt;
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
