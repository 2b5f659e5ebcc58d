#pragma once

#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"

namespace acmp {

/// One of a device's engines. For one thread at a time.
struct DeviceEngine {
  DepthEngine* engine;
  int device;    ///< number, from 0: engines with the same one share handles
  bool on_host;  ///< the CPU's
};

/// The devices of a run, and the pools of threads that the task graph has for them.
class Devices {
 public:
  explicit Devices(std::vector<ReconstructDevice> devices);

  int size() const { return static_cast<int>(devices_.size()); }
  bool on_host() const { return devices_.front().on_host; }
  std::string name() const { return devices_.front().engines.front()->device_name(); }  ///< of the first one

  /// Memory of a GPU that was free when it was taken over; 0 on the CPU. It keeps what it has been given since.
  size_t FreeBytes(int device) const { return free_bytes_.at(device); }

  int NumEngines(int device) const { return static_cast<int>(devices_.at(device).engines.size()); }
  /// @param number of the device's thread, from 0
  DeviceEngine Engine(int device, int number) const;
  /// A further one on a GPU, so that views are fused while others are matched.
  DeviceEngine FusionEngine(int device) const;

  static constexpr int kFilePool = 0;  ///< writes files
  /// A thread per engine of the device.
  static int EnginePool(int device) { return 1 + device; }
  /// One thread per device, for its FusionEngine.
  int FusionPool(int device) const { return 1 + size() + device; }
  /// Of each pool. None on the CPU, whose engine uses all cores itself: the caller's thread does everything.
  std::vector<int> PoolThreads() const;

 private:
  std::vector<ReconstructDevice> devices_;
  std::vector<std::unique_ptr<DepthEngine>> fusion_engines_;  ///< per device; none on the CPU
  std::vector<size_t> free_bytes_;                            ///< per device
};

}  // namespace acmp
