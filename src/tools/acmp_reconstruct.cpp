// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

#include <oneapi/tbb/global_control.h>
#include <signal.h>
#include <unistd.h>

#include <iostream>
#include <optional>

#include "acmp_mapping/backend/make_patch_match.h"
#include "reconstruct.h"
#include "tool_main.h"

namespace {

int RunReconstruct(const acmp::ReconstructOptions& options, acmp::InterruptWatcher* interrupt) {
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  const acmp::PatchMatchBackend backend = acmp::MakePatchMatch(acmp::ParseDevice(options.device), options.cuda_index);
  if (!backend.fallback_reason.empty() && !options.quiet) {
    std::cerr << "no GPU in use: " << backend.fallback_reason << '\n';
  }
  try {
    interrupt->RunCancellable([&] {
      acmp::Reconstruct(options, backend.patch_match.get(), interrupt, &std::cout, &std::cerr, isatty(STDERR_FILENO));
    });
    interrupt->Check();
  } catch (const acmp::Interrupted&) {
    std::cerr << "acmp_reconstruct: interrupted; run the same command again to go on\n";
    return acmp::kExitFailed;
  }
  return acmp::kExitDone;
}

int Run(int argc, char** argv) {
  signal(SIGXFSZ, SIG_IGN);  // a file that grows over its limit is then an error like a full disk
  acmp::InterruptWatcher interrupt;
  acmp::ReconstructOptions options;
  CLI::App app(
      "Computes depth, normal, cost and confidence maps of images with known poses by planar prior assisted\n"
      "PatchMatch multi-view stereo (ACMP), and fuses them into one point cloud.",
      "acmp_reconstruct");
  app.set_version_flag("--version", ACMP_VERSION);
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
