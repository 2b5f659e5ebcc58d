// acmp_reconstruct: depth, normal and cost maps and a fused point cloud of a posed image set.

#include <signal.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <future>
#include <iostream>
#include <optional>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "tool_main.h"

namespace {

/// Each GPU's first engine. They start side by side: that takes a quarter of a second each. Only the first GPU may give
/// way to the CPU: that the others are missing is an error.
std::vector<std::future<acmp::DepthEngineBackend>> StartDevices(const acmp::ReconstructOptions& options) {
  acmp::Device device = acmp::ParseDevice(options.device);
  std::vector<std::future<acmp::DepthEngineBackend>> backends;
  for (int index : options.cuda_index) {
    backends.push_back(
        std::async(std::launch::async, [device, index] { return acmp::MakeDepthEngine(device, index); }));
    if (device == acmp::Device::kCpu || options.online()) break;
    device = acmp::Device::kCuda;
  }
  return backends;
}

/// `jobs_per_gpu` engines on each GPU; where the CPU has to do, one, which uses all cores itself. The online schedule
/// works on one keyframe after the other.
std::vector<acmp::ReconstructDevice> MakeDevices(const acmp::ReconstructOptions& options) {
  std::vector<acmp::ReconstructDevice> devices;
  for (auto& starting : StartDevices(options)) {
    acmp::DepthEngineBackend backend = starting.get();
    if (!backend.fallback_reason.empty() && !options.quiet) {
      std::cerr << "no GPU in use: " + backend.fallback_reason + "\n";
    }
    acmp::ReconstructDevice& device = devices.emplace_back();
    device.on_host = backend.engine->FreeDeviceBytes() == 0;
    device.engines.push_back(std::move(backend.engine));
    if (device.on_host || options.online()) break;
    for (int job = 1; job < options.jobs_per_gpu; ++job) device.engines.push_back(device.engines.front()->Share());
  }
  return devices;
}

int RunReconstruct(const acmp::ReconstructOptions& options, acmp::InterruptWatcher* interrupt) {
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  try {
    interrupt->RunCancellable([&] {
      acmp::Reconstruct(
          options, [&] { return MakeDevices(options); }, interrupt, &std::cout, &std::cerr, isatty(STDERR_FILENO));
    });
    interrupt->Check();
  } catch (const acmp::Interrupted&) {
    std::cerr << "acmp_reconstruct: interrupted; the same command "
              << (options.online() ? "starts anew" : "goes on from here") << "\n";
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
