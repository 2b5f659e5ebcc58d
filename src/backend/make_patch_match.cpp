#include "acmp_mapping/backend/make_patch_match.h"

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/host_depth_engine.h"
#ifdef ACMP_HAVE_CUDA
#include "acmp_mapping/backend/depth_engine_cuda.h"
#include "acmp_mapping/backend/patch_match_cuda.h"
#endif

namespace acmp {
namespace {

#ifndef ACMP_HAVE_CUDA
constexpr const char* kNoCuda = "this build has no CUDA backend (configure with -DACMP_CUDA=ON)";
std::unique_ptr<PatchMatch> MakePatchMatchCuda(int /*cuda_index*/) { throw InvalidInputError(kNoCuda); }
std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int /*cuda_index*/) { throw InvalidInputError(kNoCuda); }
#endif

/// What `make_cuda` makes unless the device is kCpu; what `make_cpu` makes for that, or for kAuto with the reason.
template <class MakeCuda, class MakeCpu>
auto MakeFor(Device device, std::string* fallback_reason, const MakeCuda& make_cuda, const MakeCpu& make_cpu) {
  if (device != Device::kCpu) {
    try {
      return make_cuda();
    } catch (const std::runtime_error& error) {
      if (device == Device::kCuda) throw InvalidInputError(Concat("device = cuda: ", error.what()));
      *fallback_reason = error.what();
    }
  }
  return make_cpu();
}

}  // namespace

Device ParseDevice(const std::string& name) {
  if (name == "auto") return Device::kAuto;
  if (name == "cuda") return Device::kCuda;
  if (name == "cpu") return Device::kCpu;
  throw InvalidInputError(Concat("device = \"", name, "\": must be auto, cuda or cpu"));
}

PatchMatchBackend MakePatchMatch(Device device, int cuda_index) {
  PatchMatchBackend backend;
  backend.patch_match = MakeFor(
      device, &backend.fallback_reason, [&] { return MakePatchMatchCuda(cuda_index); }, MakePatchMatchCpu);
  return backend;
}

DepthEngineBackend MakeDepthEngine(Device device, int cuda_index) {
  DepthEngineBackend backend;
  backend.engine = MakeFor(
      device, &backend.fallback_reason, [&] { return MakeDepthEngineCuda(cuda_index); }, MakeCpuDepthEngine);
  return backend;
}

}  // namespace acmp
