#include "acmp_mapping/backend/make_depth_engine.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/host_depth_engine.h"

namespace acmp {
#ifndef ACMP_HAVE_CUDA
std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int /*cuda_index*/) {
  throw InvalidInputError("this build has no CUDA backend (configure with -DACMP_CUDA=ON)");
}
#endif

Device ParseDevice(const std::string& name) {
  if (name == "auto") return Device::kAuto;
  if (name == "cuda") return Device::kCuda;
  if (name == "cpu") return Device::kCpu;
  throw InvalidInputError(Concat("device = \"", name, "\": must be auto, cuda or cpu"));
}

DepthEngineBackend MakeDepthEngine(Device device, int cuda_index) {
  DepthEngineBackend backend;
  if (device != Device::kCpu) {
    try {
      backend.engine = MakeDepthEngineCuda(cuda_index);
      return backend;
    } catch (const std::runtime_error& error) {
      if (device == Device::kCuda) throw InvalidInputError(Concat("device = cuda: ", error.what()));
      backend.fallback_reason = error.what();
    }
  }
  backend.engine = std::make_unique<HostDepthEngine>();
  return backend;
}

}  // namespace acmp
