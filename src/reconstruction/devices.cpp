#include "devices.h"

#include <tbb/task_arena.h>

#include <algorithm>
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

Devices::Devices(std::vector<ReconstructDevice> devices) : devices_(std::move(devices)) {
  for (const ReconstructDevice& device : devices_) free_bytes_.push_back(device.engines.front()->FreeDeviceBytes());
  if (on_host()) return;
  for (const ReconstructDevice& device : devices_) fusion_engines_.push_back(device.engines.front()->Share());
}

DeviceEngine Devices::Engine(int device, int number) const {
  return {devices_.at(device).engines.at(number).get(), device, on_host()};
}

DeviceEngine Devices::FusionEngine(int device) const {
  return on_host() ? Engine(0, 0) : DeviceEngine{fusion_engines_.at(device).get(), device, false};
}

std::vector<int> Devices::PoolThreads() const {
  if (on_host()) return {};
  std::vector<int> threads = {std::max(1, tbb::this_task_arena::max_concurrency() / 2)};  // the rest triangulates
  for (int device = 0; device < size(); ++device) threads.push_back(NumEngines(device));
  threads.resize(threads.size() + devices_.size(), 1);
  return threads;
}

}  // namespace acmp
