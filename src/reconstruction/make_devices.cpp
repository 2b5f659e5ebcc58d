#include "acmp_mapping/reconstruction/make_devices.h"

#include <future>
#include <utility>

#include "acmp_mapping/backend/make_depth_engine.h"

namespace acmp {
namespace {

/// Each GPU's first engine. They start side by side: that takes a quarter of a second each. Only the first GPU may give
/// way to the CPU: that the others are missing is an error.
std::vector<std::future<DepthEngineBackend>> StartDevices(const ReconstructOptions& options) {
  Device device = ParseDevice(options.device);
  std::vector<std::future<DepthEngineBackend>> backends;
  for (int index : options.cuda_index) {
    backends.push_back(std::async(std::launch::async, [device, index] { return MakeDepthEngine(device, index); }));
    if (device == Device::kCpu || options.online()) break;
    device = Device::kCuda;
  }
  return backends;
}

}  // namespace

std::vector<ReconstructDevice> MakeDevices(const ReconstructOptions& options, std::ostream* log) {
  std::vector<ReconstructDevice> devices;
  for (auto& starting : StartDevices(options)) {
    DepthEngineBackend backend = starting.get();
    if (!backend.fallback_reason.empty() && !options.quiet) *log << "no GPU in use: " + backend.fallback_reason + "\n";
    ReconstructDevice& device = devices.emplace_back();
    device.on_host = backend.engine->FreeDeviceBytes() == 0;
    device.engines.push_back(std::move(backend.engine));
    if (device.on_host || options.online()) break;  // online one keyframe is worked on after the other
    for (int job = 1; job < options.jobs_per_gpu; ++job) device.engines.push_back(device.engines.front()->Share());
  }
  return devices;
}

}  // namespace acmp
