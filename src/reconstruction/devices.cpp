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

/// The device that works on the image at a place of the scene. Stretches of up to 16 images, of about the same length,
/// go to one device after the other: neighbours, which mostly see the same, are on the same one, and all devices are at
/// about the same place of the scene, so that few points wait for those of earlier images.
/// @param place below `images`; `devices` at least 1
/// @return the device's number, from 0
int DeviceOfPlace(size_t place, size_t images, size_t devices) {
  constexpr size_t kMaxLength = 16;  // of a stretch
  const size_t rounds = (images + kMaxLength * devices - 1) / (kMaxLength * devices);
  const size_t stretches = std::min(rounds * devices, images);
  const size_t stretch = ((place + 1) * stretches - 1) / images;  // s begins at s * images / stretches, rounded down
  return static_cast<int>(stretch % devices);
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

Devices::Devices(std::vector<ReconstructDevice> devices, const std::vector<int>& images)
    : devices_(std::move(devices)) {
  ShareOut(images);
  for (const ReconstructDevice& device : devices_) free_bytes_.push_back(device.engines.front()->FreeDeviceBytes());
  if (on_host()) return;
  for (const ReconstructDevice& device : devices_) fusion_engines_.push_back(device.engines.front()->Share());
}

void Devices::ShareOut(const std::vector<int>& images) {
  device_of_.clear();
  for (size_t place = 0; place < images.size(); ++place) {
    device_of_[images[place]] = DeviceOfPlace(place, images.size(), devices_.size());
  }
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
